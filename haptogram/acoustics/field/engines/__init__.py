"""Fast engines for the field; each is held to :mod:`haptogram.acoustics.field.reference`."""
