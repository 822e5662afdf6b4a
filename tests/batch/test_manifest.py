"""Manifests: rows become subjects, and what is wrong with one is named before any work."""

from pathlib import Path

import pytest

from gpubspline.batch.manifest import read_manifest
from gpubspline.errors import InputError

COLUMNS = {"threshold": "text", "law": "text", "mask": "file", "allow-gaps": "flag", "picture": "new file"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("a.npy", "b.npy", "mask.npy", "own.toml"):
        (tmp_path / name).write_text(name)
    return tmp_path


def written(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    path = folder / "m.csv"
    path.write_bytes(text.encode(encoding))
    return path


def test_cells_become_options(folder: Path) -> None:
    text = (
        "Subject, input ,threshold,mask,law,allow_gaps,picture\n"
        "one,a.npy,-200,,,no,\n"
        "\n"
        "two,a.npy; b.npy,,mask.npy,own.toml,yes,look.png\n"
        "three,b.npy,,,wirtz-2000\n"
    )
    for encoding in ("utf-8", "utf-8-sig"):  # spreadsheets write a byte order mark
        one, two, three = read_manifest(written(folder, text, encoding), COLUMNS)
        assert (one.name, one.line, one.options, one.files) == ("one", 2, {"threshold": "-200"}, (folder / "a.npy",))
        assert two.inputs == (folder / "a.npy", folder / "b.npy") and two.line == 4
        assert two.options == {
            "mask": str(folder / "mask.npy"),
            "law": str(folder / "own.toml"),
            "allow-gaps": "yes",
            "picture": "look.png",
        }
        assert set(two.files) == {folder / name for name in ("a.npy", "b.npy", "mask.npy", "own.toml")}
        assert three.options == {"law": "wirtz-2000"}


@pytest.mark.parametrize(
    ("text", "pattern"),
    [
        ("", "a header and a row for each subject"),
        ("subject,input\n", "below the header of m.csv, got none"),
        ("subject,input,treshold\na,a.npy,1\n", r"got 'treshold' \(did you mean threshold\?\)"),
        ("subject,input,threshold,threshold\na,a.npy,1,2\n", "'threshold' 2 times"),
        ("subject,threshold\na,1\n", "got no input"),
        ("input\na.npy\n", "got no subject"),
        ("subject,input\na,c.npy\n", r"existing file for a, line 2 of m.csv, got .*c\.npy"),
        ("subject,input,mask\na,a.npy,c.npy\n", r"existing file for a.*c\.npy"),
        ("subject,input,law\na,a.npy,c.toml\n", r"existing file for a.*c\.toml"),
        ("subject,input\na,\n", "an input for a"),
        ("subject,input\n../a,a.npy\n", r"name of letters.*'\.\./a'"),
        ("subject,input\nLogs,a.npy\n", "another name than 'Logs' in line 2 of m.csv"),
        ("subject,input\ncohort.csv,a.npy\n", "another name than 'cohort.csv'"),
        ("subject,input\na,a.npy\nA,b.npy\n", "name of its own.*lines 2 and 3"),
        ("subject,input\na,a.npy,7,8\n", "expected 2 cells in line 2.*quotes"),
        ("subject,input,allow-gaps\na,a.npy,maybe\n", "yes or no for allow-gaps of a"),
        ("subject,input,picture\na,a.npy,../p.png\n", "plain file name for picture of a"),
        ('subject,input\na,"a.npy\n', "in CSV"),
    ],
)
def test_bad_manifests_are_named_in_one_line(folder: Path, text: str, pattern: str) -> None:
    with pytest.raises(InputError, match=pattern) as caught:
        read_manifest(written(folder, text), COLUMNS)
    assert "\n" not in str(caught.value)


def test_not_a_manifest(folder: Path) -> None:
    with pytest.raises(InputError, match=r"cannot read the manifest .*nowhere"):
        read_manifest(folder / "nowhere.csv", COLUMNS)
    (folder / "m.csv").write_bytes(b"subject,input\n\xff\xfe,a.npy\n")
    with pytest.raises(InputError, match="UTF-8"):
        read_manifest(folder / "m.csv", COLUMNS)
