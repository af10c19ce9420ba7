"""``haptogram modulation``: arguments -> what a modulated focus makes felt."""
