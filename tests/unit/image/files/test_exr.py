"""EXR: what goes in comes out, and nothing half-written stays behind."""

import jax.numpy as jnp
import numpy as np
import OpenEXR
import pytest

from jaxthermo.errors import InputError
from jaxthermo.image.files.exr import read_exr, write_channels


RAMP = np.arange(12.0).reshape(3, 4) + 293.15


@pytest.mark.parametrize(
    "pixels",
    [
        RAMP.astype(np.float32),
        RAMP,
        np.asfortranarray(RAMP.astype(np.float32)),
        np.repeat(RAMP, 2, axis=1)[:, ::2],
        RAMP.T.copy().T,
        jnp.asarray(RAMP),
        jnp.asarray(RAMP, jnp.float32),
    ],
    ids=["float32", "float64", "fortran", "strided", "turned", "jax64", "jax32"],
)
def test_round_trip(tmp_path, pixels):
    path = tmp_path / "frame.exr"
    write_channels(path, {"temperature": pixels})
    channels, header = read_exr(path)
    assert list(channels) == ["temperature"] and header == {}
    assert channels["temperature"].dtype == np.float32
    assert (channels["temperature"] == RAMP.astype(np.float32)).all()


def test_many_channels_inf_and_nan(tmp_path):
    path = tmp_path / "frame.exr"
    odd = np.array([[np.nan, np.inf], [-np.inf, -0.0]], np.float32)
    write_channels(path, {"depth": odd, "R": 2 * odd, "a.b": np.ones((2, 2))})
    channels, _ = read_exr(path)
    assert set(channels) == {"depth", "R", "a.b"}
    np.testing.assert_array_equal(channels["depth"], odd)
    np.testing.assert_array_equal(channels["a.b"], 1.0)


def test_larger_image_is_compressed_without_loss(tmp_path):
    path = tmp_path / "frame.exr"
    image = np.random.default_rng(0).normal(300.0, 10.0, (101, 67)).astype(np.float32)
    write_channels(path, {"T": image, "flat": np.zeros((101, 67))})
    np.testing.assert_array_equal(read_exr(path)[0]["T"], image)
    with OpenEXR.File(str(path)) as file:
        assert file.header()["compression"] == OpenEXR.ZIP_COMPRESSION
    assert path.stat().st_size < 1.2 * image.nbytes


def test_header_round_trip(tmp_path):
    path = tmp_path / "frame.exr"
    header = {"config": "scene:\n  unit: °C\n" * 200, "empty": "", "time_s": "90.0"}
    write_channels(path, {"T": RAMP}, header)
    assert read_exr(path)[1] == header


def test_replaces_the_old_file(tmp_path):
    path = tmp_path / "frame.exr"
    write_channels(path, {"T": RAMP})
    write_channels(str(path), {"T": RAMP + 1})
    assert read_exr(path)[0]["T"][0, 0] == np.float32(294.15)
    assert [p.name for p in tmp_path.iterdir()] == ["frame.exr"]


def test_failure_keeps_the_old_file_and_leaves_nothing(tmp_path, monkeypatch):
    path = tmp_path / "frame.exr"
    write_channels(path, {"T": RAMP})
    content = path.read_bytes()

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("os.replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_channels(path, {"T": RAMP + 1})
    assert path.read_bytes() == content
    assert [p.name for p in tmp_path.iterdir()] == ["frame.exr"]


def test_unwritable_places(tmp_path):
    (tmp_path / "file").write_text("")
    places = [tmp_path / "no" / "a.exr", tmp_path / "file" / "a.exr", tmp_path]
    for path in places:
        with pytest.raises(InputError, match="cannot write") as caught:
            write_channels(path, {"T": RAMP})
        assert "\n" not in str(caught.value)
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("channels", "header", "says"),
    [
        ({}, {}, "needs a channel"),
        ({"a": np.zeros((2, 2)), "b": np.zeros((2, 3))}, {}, "one shape"),
        ({"a": np.zeros((0, 3))}, {}, "at least one pixel"),
        ({"": np.zeros((2, 2))}, {}, "1 to 255 bytes"),
        ({"a": np.zeros((2, 2))}, {"n" * 300: ""}, "1 to 255 bytes"),
        ({"a": np.zeros((2, 2))}, {"compression": "zip"}, "reserved"),
    ],
)
def test_what_the_format_cannot_hold(tmp_path, channels, header, says):
    with pytest.raises(InputError, match=says):
        write_channels(tmp_path / "frame.exr", channels, header)
    assert list(tmp_path.iterdir()) == []


def test_damaged_and_missing_files(tmp_path):
    path = tmp_path / "frame.exr"
    with pytest.raises(InputError, match="not a file"):
        read_exr(path)
    write_channels(path, {"T": np.random.default_rng(1).normal(size=(64, 64))})
    content = path.read_bytes()
    middle = len(content) // 2
    for damaged in (b"", b"no image", content[:middle], content[:-3], content[:120]):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match="damaged") as caught:
            read_exr(path)
        assert "\n" not in str(caught.value)


def test_reads_half_floats_of_others(tmp_path):
    path = tmp_path / "half.exr"
    fields = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(fields, {"Y": np.ones((2, 3), np.float16)}) as file:
        file.write(str(path))
    assert read_exr(path)[0]["Y"].dtype == np.float32
