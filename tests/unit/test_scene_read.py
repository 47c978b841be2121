"""Reading a scene file: where each key stands, and files that cannot be read."""

from __future__ import annotations

import tomllib

import pytest

from thirdbody.errors import InputError
from thirdbody.scene.model import Scene
from thirdbody.scene.toml_positions import locate


def test_positions_inside_every_form_of_toml():
    text = """\
# [comment]
top = 'lit # no comment'
"quoted key" = 1
a . b = {k1 = [1, {k2 = "}", k3 = 2}], "k\\u0034" = 3} # {k9 = 1}
multi = [
  "x]", # ]
  [ 'y', "z\\"" ],
]
long = \"\"\"
fake = 1
"" \\\"\"\" \"\"\"\"
raw = '''
[fake]
'''''
[t.u]
v = 1979-05-27 07:32:00
[[arr]]
w = 1
[arr.sub]
q = 1
[[arr]]
w = 2
[[arr.deep]]
e = +1.5e3
"""
    tomllib.loads(text)  # or the test itself is wrong
    at = locate(text)
    assert at[("top",)] == (2, 1)
    assert at[("quoted key",)] == (3, 1)
    assert at[("a", "b")] == (4, 1)
    assert at[("a", "b", "k1")] == (4, 10)
    assert at[("a", "b", "k1", 1)] == (4, 19)
    assert at[("a", "b", "k1", 1, "k2")] == (4, 20)
    assert at[("a", "b", "k1", 1, "k3")] == (4, 30)
    assert at[("a", "b", "k4")] == (4, 40)
    assert at[("multi", 0)] == (6, 3)
    assert at[("multi", 1, 1)] == (7, 10)
    assert at[("t", "u", "v")] == (16, 1)
    assert at[("arr", 0, "sub", "q")] == (20, 1)
    assert at[("arr", 1)] == (21, 1)
    assert at[("arr", 1, "w")] == (22, 1)
    assert at[("arr", 1, "deep", 0, "e")] == (24, 1)
    assert not any("fake" in place or "k9" in place for place in at)
    assert locate(text.replace("\n", "\r\n")) == at


def test_files_that_cannot_be_read(tmp_path, monkeypatch):
    def report(path):
        with pytest.raises(InputError) as caught:
            Scene.load(path)
        (fault,) = caught.value.faults
        return str(fault).removeprefix(str(path))

    assert report(tmp_path / "none.toml") == ": no such file"
    assert report(tmp_path) == ": is a folder, expected a scene file"
    latin = tmp_path / "latin.toml"
    latin.write_bytes("scene = 1\ntitle = 'r\N{LATIN SMALL LETTER O WITH DIAERESIS}'\n".encode("latin-1"))
    assert report(latin) == ":2:11: is not UTF-8 text: save it as UTF-8"

    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("builtins.open", refuse)
    assert report(latin) == ": cannot be read: Permission denied"
