"""The methods CF-SMA is measured against: IDC, Cox, angle histograms, ICP and point-to-line ICP.

Stages that more than one of them shares stand here once; each method's outline is a file of
``curvescan.matching``.
"""
