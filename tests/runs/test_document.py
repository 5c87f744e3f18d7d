"""Reports: the same text as Markdown and as a page that stands alone."""

from __future__ import annotations

import base64
import html.parser

from curvescan.runs.document import ResultTable, save_document

PNG = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)


class Page(html.parser.HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.tags, self.images, self.cells, self._cell = [], [], [], None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag == "img":
            self.images.append(dict(attrs))
        self._cell = [] if tag in ("td", "th") else self._cell

    def handle_data(self, data):
        if self._cell is not None:
            self._cell.append(data)

    def handle_endtag(self, tag):
        if tag in ("td", "th"):
            self.cells.append("".join(self._cell))
            self._cell = None


def test_a_report_is_a_page_with_its_tables_and_figures_inside(tmp_path):
    (tmp_path / "map.png").write_bytes(PNG)
    table = ResultTable(
        title="Errors <of> all",
        columns=("method", "|error| [m]"),
        rows=(("<script>x</script>", "1.0"), ("a_b * c", "±2 & 3")),
    )
    save_document(tmp_path, "A & B", ["# Report", "Two < three, as *it* is.", table, ("map.png", "The map")])
    markdown = (tmp_path / "report.md").read_text("utf-8")
    assert "# Report" in markdown
    assert "![The map](map.png)" in markdown
    page = Page((tmp_path / "report.html").read_text("utf-8"))
    assert "script" not in page.tags
    assert page.tags.count("table") == 1
    assert page.cells == ["method", "|error| [m]", "<script>x</script>", "1.0", "a_b * c", "±2 & 3"]
    (image,) = page.images
    assert image["alt"] == "The map"
    assert image["src"] == "data:image/png;base64," + base64.b64encode(PNG).decode()
    assert {"h1", "h3", "em", "title"} <= set(page.tags)


def test_wide_tables_are_split_and_keep_their_keys():
    table = ResultTable(title="t", columns=("log", "method", "a", "b"), keys=2, rows=[("l", "m", "1" * 60, "2" * 60)])
    halves = table.markdown(120).split("\n\n")[1:]
    assert [half.splitlines()[0] for half in halves] == ["| log | method | a |", "| log | method | b |"]
    assert all(half.splitlines()[2].startswith("| l | m | ") for half in halves)
    assert table.markdown().count("| log |") == 1
