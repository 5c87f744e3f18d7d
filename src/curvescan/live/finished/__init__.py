"""Finished runs on the page of `live`: results folders and maps in; a page, or one HTML file, out."""
