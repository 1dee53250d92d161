"""The account of what one untrusted source takes: bytes, parts, seconds."""

import pytest

from davis_rs import DecodeError
from davis_rs.budget import VARIABLE, Budget, Limits, limits_in_use


def test_bytes_that_stay_add_up_and_borrowed_ones_come_back() -> None:
    budget = Budget("scene.glb", Limits(bytes=1000))
    budget.take(600, "image 0")
    with budget.borrow(400, "image 1"):
        with pytest.raises(DecodeError, match=r"^scene.glb: image 2 needs 1 bytes, 1000 bytes are in use; 1000 bytes"):
            budget.take(1, "image 2")
        assert budget.bytes == 1000
    budget.take(400, "image 2")
    budget.give_back(1000)
    assert budget.bytes == 0


def test_a_refused_charge_leaves_the_account_as_it_was() -> None:
    budget = Budget("scene.glb", Limits(bytes=1000))
    with pytest.raises(DecodeError, match=r"image 0 needs 1.5 KiB; 1000 bytes may be held in memory"):
        budget.take(1536, "image 0")
    budget.take(1000, "image 1")
    assert budget.bytes == 1000


def test_parts_are_counted_over_all_kinds() -> None:
    budget = Budget("scene.glb", Limits(items=10))
    budget.count(6, "nodes")
    budget.count(4, "accessors")
    with pytest.raises(
        DecodeError, match=r"more than 10 parts, the last of them materials \(DAVIS_RS_READ_BUDGET=items"
    ):
        budget.count(1, "materials")


def test_time_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr("davis_rs.budget.time.monotonic", lambda: now[0])
    budget = Budget("bag.db3", Limits(seconds=5))
    now[0] = 105.0
    budget.check_time("a query")
    assert not budget.out_of_time()
    now[0] = 105.1
    assert budget.out_of_time()
    with pytest.raises(DecodeError, match=r"bag.db3: a query has taken more than 5 s"):
        budget.check_time("a query")


def test_one_variable_of_the_environment_sets_the_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    assert limits_in_use() == Limits()
    monkeypatch.setenv(VARIABLE, "bytes=8GiB items=1e8 seconds=0.5")
    assert limits_in_use() == Limits(bytes=8 << 30, items=10**8, seconds=0.5)
    monkeypatch.setenv(VARIABLE, "seconds=7")
    assert Budget("x").limits == Limits(seconds=7)


@pytest.mark.parametrize(
    "wrong", ["8GiB", "bytes=", "bytes=-1", "bytes=0", "bytes=1.2.3", "items=2GiB", "hours=1", "bytes=1e99"]
)
def test_a_variable_that_cannot_be_understood_is_an_error(monkeypatch: pytest.MonkeyPatch, wrong: str) -> None:
    monkeypatch.setenv(VARIABLE, wrong)
    with pytest.raises(ValueError, match=r"DAVIS_RS_READ_BUDGET is like .*: got '"):
        limits_in_use()


def test_time_that_is_spent_adds_up() -> None:
    budget = Budget("a.bag", Limits(seconds=5))
    budget.spend(3.0, "unpacking")
    budget.start_clock()
    with pytest.raises(DecodeError, match=r"a.bag: unpacking has taken more than 5 s \(DAVIS_RS_READ_BUDGET=seconds"):
        budget.spend(2.5, "unpacking")
