"""What is packed is unpacked within half a step, turns are the same, and smooth motion becomes small."""

import gzip

import numpy as np
import pytest

from stridelab_web.scene.frame_codec import POSE_BITS, continuous_signs, fit_bits, pack_columns
from stridelab_web.scene.frames import Body, Frames
from support.browser.page import unpack


def there_and_back(values: np.ndarray, bits: np.ndarray) -> np.ndarray:
    n, width = values.shape
    return unpack(pack_columns(values, bits), {"n_frames": n, "width": width, "bits": bits.tolist()})


@pytest.mark.parametrize("n", [1, 2, 3, 50])
def test_numbers_come_back_within_half_a_step_and_gaps_as_gaps(n: int) -> None:
    rng = np.random.default_rng(n)
    values = rng.normal(scale=(1.0, 30.0, 700.0), size=(n, 3)).astype(np.float32)
    values[rng.random((n, 3)) < 0.2] = np.nan
    bits = np.array([20, 16, 11])
    back = there_and_back(values, bits)
    np.testing.assert_array_equal(np.isnan(back), np.isnan(values))
    off = np.abs(back.astype(float) - values)
    assert (off[np.isfinite(off)] <= np.broadcast_to(0.5 * 2.0**-bits * 1.01 + 1e-7 * np.abs(values), off.shape)[
        np.isfinite(off)
    ]).all()  # fmt: skip


def test_numbers_too_large_for_their_step_are_written_in_larger_ones() -> None:
    values = np.array([[2.0**8, 3e6], [-(2.0**8), -3e6], [2.0**8, np.inf]], dtype=np.float32)
    bits = fit_bits(values, np.array([20, 20]))
    assert bits.tolist() == [20, 6]
    np.testing.assert_array_equal(there_and_back(values, bits)[:, 0], values[:, 0])
    np.testing.assert_array_equal(there_and_back(values, bits)[:2, 1], values[:2, 1])


def test_turns_stay_the_same_without_jumps_of_their_sign() -> None:
    half = np.linspace(0, 2, 40)
    smooth = np.column_stack([np.cos(half), 0 * half, 0 * half, np.sin(half)])
    jumping = np.where(np.arange(40) % 2 == 0, 1.0, -1.0)[:, None] * smooth
    np.testing.assert_array_equal(continuous_signs(jumping), smooth)
    jumping[10:20] = np.nan
    whole = continuous_signs(jumping)
    np.testing.assert_array_equal(np.abs(whole), np.abs(jumping))
    assert (np.einsum("ij,ij->i", whole[21:], whole[20:-1]) > 0).all()


def test_a_smooth_motion_is_a_tenth_of_its_numbers() -> None:
    time_s = np.arange(1000) / 50
    pose = np.column_stack([np.sin(time_s + k) for k in range(7)])
    frames = Frames(time_s, pose.astype(np.float32), bodies=(Body("/robot/link", 0),))
    packed = frames.packed_values()
    assert len(gzip.compress(packed)) < 0.1 * frames.values.nbytes
    assert frames.to_layout()["bits"] == [POSE_BITS] * 7
