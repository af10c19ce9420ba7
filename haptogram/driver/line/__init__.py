"""The line between host and board: ports, the pumps behind them, how much they carry."""
