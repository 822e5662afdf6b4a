"""Output files appear whole or not at all, and take the place of nothing but files."""

import errno
import os

import pytest

from gpubspline.errors import InputError
from gpubspline.files import check_apart, check_folder, check_writable, reserve, whole_file


def test_a_file_appears_when_it_is_whole(tmp_path):
    path = tmp_path / "a.json"
    with whole_file(path) as temporary:
        temporary.write_text("new")
        assert temporary.suffix == ".json" and not path.exists()
    assert path.read_text() == "new" and [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_names_as_long_as_file_systems_take(tmp_path):
    path = tmp_path / ("ü" * 125 + ".json")  # 255 bytes
    with whole_file(path) as temporary:
        temporary.write_text("new")
    assert path.read_text() == "new" and list(tmp_path.iterdir()) == [path]
    with pytest.raises(InputError, match=r"cannot write üü.*: File name too long"):
        check_writable(tmp_path / ("ü" * 126 + ".json"))


@pytest.mark.parametrize("interrupt", [KeyboardInterrupt, OSError, SystemExit])
def test_nothing_is_left_of_what_was_interrupted(tmp_path, interrupt):
    path = tmp_path / "a.json"
    path.write_text("old")
    with pytest.raises(interrupt), whole_file(path) as temporary:
        temporary.write_text("ne")
        raise interrupt
    assert path.read_text() == "old" and [p.name for p in tmp_path.iterdir()] == ["a.json"]


@pytest.mark.parametrize(
    ("error", "cause"),
    [
        (OSError(errno.ENOSPC, "file write failed: time = Thu"), None),
        (OSError("No space left on device (os error 28)"), None),  # polars
        (OSError("With tag (7FE0,0010) got exception: Traceback"), OSError(errno.ENOSPC, "No space left")),  # pydicom
    ],
)
def test_a_full_disk_is_told_with_the_file(tmp_path, error, cause):
    with pytest.raises(OSError, match=r"No space left on device: .*m\.inp") as raised, whole_file(tmp_path / "m.inp"):
        raise error from cause
    assert raised.value.errno == errno.ENOSPC and raised.value.filename == str(tmp_path / "m.inp")
    with pytest.raises(PermissionError), whole_file(tmp_path / "m.inp"):
        raise PermissionError(errno.EACCES, "denied")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes in the file system are POSIX")
def test_devices_and_pipes_are_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="got the device or pipe"):
        check_writable(tmp_path / "pipe")
    (tmp_path / "link.json").symlink_to(tmp_path / "pipe")
    with pytest.raises(InputError, match="got the device or pipe"), whole_file(tmp_path / "link.json"):
        pytest.fail("a pipe was taken for a file")


def test_links_are_followed(tmp_path):
    (tmp_path / "there").mkdir()
    link, target = tmp_path / "link.json", tmp_path / "there" / "kept.json"
    link.symlink_to(target)
    for text in ("first", "second"):  # what a link leads to need not be there yet
        with whole_file(link) as temporary:
            assert temporary.parent == target.parent
            temporary.write_text(text)
        assert link.is_symlink() and target.read_text() == text
    (tmp_path / "astray.json").symlink_to(tmp_path / "nowhere" / "a.json")
    with pytest.raises(InputError, match="nowhere, which does not exist"):
        check_writable(tmp_path / "astray.json")


def test_what_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    for path, words in ((tmp_path, "got the folder"), (tmp_path / "no" / "a.json", "which does not exist")):
        with pytest.raises(InputError, match=words):
            check_writable(path)
    with pytest.raises(InputError, match="expected a folder to fill"):
        check_folder(tmp_path / "file")
    with pytest.raises(InputError, match="for two files of this run"):
        check_apart([tmp_path / "a", tmp_path / "b" / ".." / "a"])
    with pytest.raises(InputError, match=r"got the input .*a, which would be lost"):
        check_apart([tmp_path / "a"], [tmp_path / "b" / ".." / "a"])


def test_space_is_taken_before_a_file_is_filled(tmp_path, monkeypatch):
    """Where the system can; elsewhere a file grows as it is written, and a full disk is told of in both ways."""
    with open(tmp_path / "a.vtu", "wb") as stream:
        reserve(stream, 100_000)
        assert stream.write(b"whole") == 5
    assert (tmp_path / "a.vtu").read_bytes()[:6] == b"whole\0"

    def cannot(*args):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "posix_fallocate", cannot, raising=False)
    with open(tmp_path / "b.vtu", "wb") as stream:
        number = errno.EOPNOTSUPP
        reserve(stream, 100_000)
        number = errno.ENOSPC
        with pytest.raises(OSError, match="No space left"):
            reserve(stream, 100_000)
        monkeypatch.delattr(os, "posix_fallocate")
        reserve(stream, 100_000)
