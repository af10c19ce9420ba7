"""The commands that read recordings and bytes: decode, replay, repair."""
