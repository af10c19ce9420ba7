"""The serial line: rate, sampling, and the ports where bytes come and go; none knows frames."""
