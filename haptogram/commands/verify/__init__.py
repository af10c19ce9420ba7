"""``haptogram verify``: arguments -> one run and its verdict."""
