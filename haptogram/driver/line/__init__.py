"""The line between host and board: ports, the pump behind them, and how much they carry."""
