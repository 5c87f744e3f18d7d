"""The methods CF-SMA is measured against: IDC, Cox, angle histograms, ICP and point-to-line ICP."""
