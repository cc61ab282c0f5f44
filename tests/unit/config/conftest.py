"""What tests of scene files share."""

import pytest

from jaxthermo.errors import InputError


@pytest.fixture
def refused(scene):
    """A function with the arguments of `scene` to the lines of its refusal.

    The lines are without the file's name; a module has the fixture `scene`.
    """

    def load(*arguments: str, **options: object) -> list[str]:
        with pytest.raises(InputError) as caught:
            scene(*arguments, **options)
        return [line.split(": ", 1)[1] for line in str(caught.value).splitlines()]

    return load
