"""The command of the virtual board: its options, the files that it writes, and its run."""
