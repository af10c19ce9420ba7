"""Programs that others wrote, unmodified, against the virtual board: ci/clients."""
