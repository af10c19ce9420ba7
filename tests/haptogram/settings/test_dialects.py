"""The names of help texts are those of the codecs."""

from haptogram.settings.dialects import DIALECT_TITLES, OWN_DIALECT
from haptogram_protocol.dialects.looks_like import HAPTOGRAM
from haptogram_protocol.dialects.table import DIALECTS


def test_names_and_titles_are_those_of_the_dialects_in_their_order():
    titles = {name: dialect.title for name, dialect in DIALECTS.items()}
    assert list(DIALECT_TITLES.items()) == list(titles.items())
    assert OWN_DIALECT == HAPTOGRAM
