"""Labels in a picture: near the middle of what they name, and never on one another."""

import numpy as np
from hypothesis import given, strategies as st

from jaxthermo.image.colour.label_places import label_places


PICTURE = np.array([[0.0, 0.0], [200.0, 100.0]])
NOTHING = np.array([[-2.0, -2.0], [-1.0, -1.0]])
HALF = np.array([20.0, 5.0])


def square(x, y, edge=20):
    rows, columns = np.indices((edge, edge)).reshape(2, -1)
    return np.stack([columns + x, rows + y], axis=1).astype(float)


def test_a_label_alone_is_at_the_middle_of_its_area():
    (place,) = label_places([square(90, 40)], [HALF], PICTURE, taken=NOTHING)
    assert place is not None
    np.testing.assert_allclose(place, (99.5, 49.5), atol=0.51)


def test_labels_that_would_cover_each_other_are_moved_or_left_out():
    areas = [square(90, 40, 20), square(85, 35, 30)]
    small, large = label_places(areas, [HALF, HALF], PICTURE, taken=NOTHING)
    assert small is not None and large is not None
    # The small area comes first; the large one has its label beside it.
    np.testing.assert_allclose(small, (99.5, 49.5), atol=0.51)
    assert abs(large[1] - small[1]) >= 10
    assert any((areas[1] == large).all(axis=1))
    # Two areas that are narrower than a label is high.
    areas = [square(90, 40, 4), square(91, 41, 5)]
    first, second = label_places(areas, [HALF, HALF], PICTURE, taken=NOTHING)
    assert first is not None and second is None


def test_what_is_taken_stays_free_and_labels_are_within_the_picture():
    corner = np.array([[0.0, 60.0], [40.0, 100.0]])
    places = label_places([square(0, 80, 20)], [HALF], PICTURE, taken=corner)
    assert places == [None]
    (place,) = label_places([square(190, 0, 10)], [HALF], PICTURE, taken=corner)
    assert place is not None
    np.testing.assert_array_equal(place, (180.0, 5.0))


@given(st.lists(st.tuples(st.integers(0, 180), st.integers(0, 80)), max_size=12))
def test_no_two_labels_overlap(corners):
    areas = [square(x, y) for x, y in corners]
    places = label_places(areas, [HALF] * len(areas), PICTURE, taken=NOTHING)
    placed = [place for place in places if place is not None]
    assert not areas or placed
    for number, place in enumerate(placed):
        assert (place >= PICTURE[0] + HALF).all() and (place <= PICTURE[1] - HALF).all()
        for other in placed[:number]:
            assert (np.abs(place - other) >= 2 * HALF).any()
