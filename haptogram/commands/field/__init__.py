"""``haptogram field``: arguments -> a field, its levels and its pictures."""
