"""Findings: kept by identity and values, dropped with their objects, bounded."""

import gc
import threading

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxthermo.memo import found as findings
from jaxthermo.memo.found import (
    digest,
    findings_size,
    forget_findings,
    found,
    on_device,
    searches_recorded,
)


class _Owner:
    pass


@pytest.fixture(autouse=True)
def nothing_found_yet():
    forget_findings()


def test_what_was_found_is_not_searched_again():
    owner = _Owner()
    calls = []

    def find():
        return calls.append(1) or np.arange(3.0)

    first = found((owner,), ("a", 1.0), find)
    assert found((owner,), ("a", 1.0), find) is first
    assert len(calls) == 1
    found((owner,), ("a", 2.0), find)
    found((_Owner(),), ("a", 1.0), find)
    assert len(calls) == 3


def test_findings_end_with_their_objects():
    mortal = _Owner()
    owner = _Owner()
    found((mortal, owner), "both", lambda: np.zeros(1000))
    found((owner,), "other", lambda: np.zeros(10))
    assert findings_size() == (2, 8080)
    del mortal
    gc.collect()
    assert findings_size() == (1, 80)


def test_another_object_at_the_same_address_is_another_object():
    values = []
    for n in range(50):
        owner = _Owner()
        values.append(found((owner,), "same", lambda n=n: n))
        del owner
    assert values == list(range(50))


def test_least_recently_used_findings_are_dropped(monkeypatch):
    monkeypatch.setattr(findings, "MAX_BYTES", 3900)
    owner = _Owner()
    calls = []

    def find(name):
        return calls.append(name) or np.zeros(125)

    for name in "abcabd":
        found((owner,), name, lambda name=name: find(name))
    # `c` was used before `a` and `b`.
    for name in "ab":
        found((owner,), name, lambda name=name: find(name))
    assert calls == ["a", "b", "c", "d"]
    found((owner,), "c", lambda: find("c"))
    assert calls[-1] == "c"
    found((owner,), "large", lambda: np.zeros(1000))
    assert findings_size()[1] <= 3900


def test_findings_are_added_up_only_near_their_limit(monkeypatch):
    """A search would take longer, the more was found before."""
    monkeypatch.setattr(findings, "MAX_BYTES", 10_000)
    monkeypatch.setattr(findings, "_bytes_at_most", 0)
    counts = []

    def counted():
        counts.append(len(findings._entries))
        return findings_size()

    monkeypatch.setattr(findings, "findings_size", counted)
    owner = _Owner()
    for number in range(9):
        found((owner,), number, lambda: np.zeros(125))
    assert not counts
    for number in range(9, 200):
        found((owner,), number, lambda: np.zeros(125))
        assert findings_size()[1] <= 10_000
    # Each time there is room for three more.
    assert len(counts) == 64


def test_kept_arrays_cannot_be_written_to():
    owner = _Owner()
    array, *_ = found((owner,), "arrays", lambda: (np.zeros(3), "text"))
    with pytest.raises(ValueError, match="read-only"):
        array[0] = 1.0


def test_what_cannot_be_compared_is_not_kept():
    owner = _Owner()
    for by in (None, ("list", [1])):
        assert found((owner,), by, lambda: 1) == 1
    assert findings_size() == (0, 0)


def test_traced_values_are_not_kept():
    owner = _Owner()

    @jax.jit
    def run(x):
        found((owner,), "known", lambda: jnp.arange(3))
        return found((owner,), "traced", lambda: 2 * x)

    assert float(run(jnp.asarray(3.0))) == 6.0
    assert findings_size()[0] == 1
    stored = found((owner,), "known", lambda: None)
    np.testing.assert_array_equal(stored, [0, 1, 2])


def test_precision_is_part_of_what_was_found():
    owner = _Owner()
    find = lambda: jnp.asarray(np.zeros(2))
    assert found((owner,), "zeros", find).dtype == jnp.float64
    with jax.enable_x64(False):
        assert found((owner,), "zeros", find).dtype == jnp.float32


def test_only_searches_that_are_made_are_recorded():
    owner = _Owner()
    with searches_recorded() as names:
        found((owner,), by="a", find=lambda: 1, search="search a")
        found((owner,), by="a", find=lambda: 1, search="search a")
        found((owner,), "b", lambda: 1)
    assert names == ["search a"]


def test_arrays_are_compared_by_type_shape_and_values():
    assert digest(np.arange(3)) != digest(np.arange(3.0))
    assert digest(np.ones(9, bool)) != digest(np.ones(10, bool))


def test_threads_share_findings(monkeypatch):
    monkeypatch.setattr(findings, "MAX_BYTES", 20_000)
    owners = [_Owner() for _ in range(5)]
    wrong = []

    def work():
        for n in range(300):
            number = n % 7
            value = found(
                (owners[n % 5],), number, lambda number=number: np.full(100, number)
            )
            wrong.extend([n] * int((np.asarray(value) != number).any()))

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
    assert findings_size()[1] <= 20_000


def test_an_array_that_can_still_change_is_hashed_again():
    array = np.arange(4.0)
    view = array[:]
    view.flags.writeable = False
    first_digest = findings.digest(view)
    array[0] = 5.0
    assert findings.digest(view) != first_digest
    array.flags.writeable = False
    assert findings.digest(array) == findings.digest(view)


def test_arrays_go_to_the_device_and_all_else_stays():
    on_host = np.arange(3.0)
    moved, again, number, name = on_device((on_host, on_host, 2, "name"))
    assert isinstance(moved, jax.Array)
    np.testing.assert_array_equal(moved, on_host)
    assert again is moved
    assert (number, name) == (2, "name")


def test_known_arrays_stay_known_where_others_are_traced():
    def sum_of(x):
        moved, traced = on_device((np.arange(3.0), x))
        assert traced is x
        return np.asarray(moved).sum() * traced

    assert float(jax.jit(sum_of)(2.0)) == 6.0
