"""``haptogram conform``: arguments -> one run of the conformance suite."""
