import pytest

from haptogram.errors import LinkError
from haptogram.machine.closing import ClosedByWith


class Stuck(ClosedByWith):
    def close(self):
        raise LinkError("it does not close")


def test_what_does_not_close_is_an_error():
    with pytest.raises(LinkError, match="it does not close"), Stuck():
        pass


def test_an_error_in_the_block_goes_on_and_notes_what_did_not_close():
    with pytest.raises(KeyError) as caught, Stuck():
        raise KeyError
    assert caught.value.__notes__ == ["it does not close"]
