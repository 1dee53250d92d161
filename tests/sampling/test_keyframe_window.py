"""The window of keyframes that adaptive sampling works on: what it keeps must not change what it finds."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from davis_rs.sampling.keyframe_window import KeyframeWindow
from davis_rs.sampling.keyframes import slope

Frame = npt.NDArray[np.float32]


def frame_at(t_us: int) -> Frame:
    """Log luma of a few pixels: still, a parabola, a wave, a jump."""
    t = t_us / 1000
    return np.array([[0.0, 0.01 * t * t, np.sin(t), float(t > 5)]], np.float32)


def filled(times: list[int], cuts: set[int]) -> KeyframeWindow:
    window = KeyframeWindow()
    frames = [frame_at(t_us) for t_us in times]
    window.insert(times, frames, frames)
    window.cuts = set(cuts)
    return window


@given(
    gaps=st.lists(st.one_of(st.just(1), st.integers(2, 3000)), min_size=6, max_size=14),
    dropped=st.integers(0, 3),
    late=st.data(),
)
def test_a_window_that_grew_finds_what_a_new_one_finds(gaps: list[int], dropped: int, late: st.DataObject) -> None:
    """Keyframes may come in any order, and others may have been dropped: predictions that were kept are still right."""
    times = np.cumsum([0, *gaps]).tolist()
    cuts = {t_us for t_us, gap in zip(times, gaps, strict=False) if gap == 1}
    order = late.draw(st.permutations(range(len(times))))
    window = filled([times[i] for i in sorted(order[:5])], cuts)
    window.untrusted(0.05)
    for i in order[5:]:
        window.insert([times[i]], [frame_at(times[i])], [frame_at(times[i])])
        window.untrusted(0.05)
    window.drop(dropped)
    new = filled(times[dropped:], {t_us for t_us in cuts if t_us >= times[dropped]})
    window.complete = new.complete = True
    assert window.t_us == new.t_us
    assert window.cuts == new.cuts
    for kept, fresh in zip(window.untrusted(0.05), new.untrusted(0.05), strict=True):
        assert np.array_equal(kept, fresh)


def test_a_smooth_pixel_is_trusted_and_a_jump_is_not() -> None:
    """At 1/5 of a wave's radian its neighbours predict it to 5 %; a jump is untrusted on both of its sides."""
    window = filled(list(range(0, 10_001, 200)), set())
    window.complete = True
    untrusted = np.array([found[0] for found in window.untrusted(0.05)])
    assert not untrusted[:, :3].any()
    jump = 5000 // 200  # the interval in which it is
    assert untrusted[jump, 3]
    assert not untrusted[: jump - 3, 3].any()
    assert not untrusted[jump + 4 :, 3].any()


def test_slopes_do_not_look_across_a_cut() -> None:
    """On both sides of a cut the slope is that of its own part; alone in a part a keyframe has none."""
    times = [0, 1000, 2000, 2001, 3000, 3001, 4000]
    window = filled(times, {2000, 3000})
    frames = [frame_at(t_us) for t_us in times]
    assert window.parts().tolist() == [0, 0, 0, 1, 1, 2, 2]
    assert np.array_equal(window.slope(2), slope(times[1:3], frames[1:3], 1))
    assert np.array_equal(window.slope(3), slope(times[3:5], frames[3:5], 0))
    assert np.array_equal(window.slope(1), slope(times[:3], frames[:3], 1))
    alone = filled([0, 1, 2], {0, 1})
    assert not alone.slope(1).any()


def test_slopes_are_those_of_the_longer_interval() -> None:
    """A keyframe close by, as one that a frame wants, does not decide the slope in the long interval next to it."""
    times = [0, 1000, 2000, 2001, 3000, 4000]
    frames = [np.array([[level]], np.float32) for level in (0.0, 0.3, -0.2, -0.1, 0.4, 0.0)]
    window = KeyframeWindow()
    window.insert(times, frames, frames)
    assert np.array_equal(window.slope(2), slope([1000, 2000, 3000], [frames[i] for i in (1, 2, 4)], 1))
    assert np.array_equal(window.slope(3), slope([1000, 2001, 3000], [frames[i] for i in (1, 3, 4)], 1))
    window = KeyframeWindow()
    window.insert(times[:4], frames[:4], frames[:4])
    assert np.array_equal(window.slope(2), slope([1000, 2000], frames[1:3], 1))  # nothing comes that is far enough


def test_too_few_keyframes_are_judged_by_their_change() -> None:
    """Nothing can be predicted from two keyframes: where they differ by more than is tolerated nothing is trusted."""
    window = filled([0, 1000], set())
    assert not window.untrusted(0.05)[0].any()  # more of the part is still to come
    window.complete = True
    assert window.untrusted(0.05)[0].tolist() == [[False, False, True, False]]
    assert window.untrusted(0.005)[0].tolist() == [[False, True, True, False]]


def test_a_window_begins_empty() -> None:
    assert KeyframeWindow().untrusted(0.05) == []
    with pytest.raises(IndexError):
        KeyframeWindow().drop(1)
