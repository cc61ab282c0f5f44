"""YAML: no surprises of version 1.1, no duplicate keys, one line for a mistake."""

import pytest
import yaml

from jaxthermo.config import strict_yaml
from jaxthermo.config.strict_yaml import (
    parse_yaml,
    read_yaml,
    write_flow,
    write_yaml,
)
from jaxthermo.errors import InputError


def test_reads_what_is_written():
    text = "{on: yes, a: 1e-3, b: 010, c: '1:30', d: 1:30, e: true, f: ~, g: -.5, h: }"
    assert parse_yaml(text, "x") == {
        "on": "yes",
        "a": 1e-3,
        "b": 10,
        "c": "1:30",
        "d": "1:30",
        "e": True,
        "f": None,
        "g": -0.5,
        "h": None,
    }


@pytest.mark.parametrize("text", ["-.inf", ".inf", ".nan", "1e999"])
def test_not_finite_is_a_float(text):
    assert isinstance(parse_yaml(text, "x"), float)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "a: 1\nb:\n  c: 1\n  c: 2\n",
            r"x, line 4, column 3: the key 'c' is given twice",
        ),
        ("a: [1, 2\nb: 3", r"x, line 2, column"),
        ("a: !!python/object:os.system {}", r"tag .* is not allowed"),
        ("a: !foo 3", r"not allowed"),
        ("1: 2", r"must be a word"),
        ("a: &b [*b]\nc: *d", r"line 2"),
        ("a: 1\n---\nb: 2", r"line 2"),
        ("a: !!int b", r"not valid YAML"),
        ("a: " + "9" * 5000, r"not valid YAML"),
        ("[" * 3000, r"nested too deeply"),
        ("a: \x00", r"not valid YAML"),
    ],
)
def test_mistake_is_one_line(text, message):
    with pytest.raises(InputError, match=message) as caught:
        parse_yaml(text, "x")
    assert "\n" not in str(caught.value)


def test_unreadable_files(tmp_path):
    (tmp_path / "empty.yaml").write_text("# nothing\n")
    (tmp_path / "list.yaml").write_text("- a\n")
    (tmp_path / "junk.yaml").write_bytes(bytes(range(256)))
    for name, message in {
        "empty.yaml": "is empty",
        "list.yaml": "top level",
        "junk.yaml": "not a text file",
        "missing.yaml": "no such file",
        ".": "directory",
    }.items():
        with pytest.raises(InputError, match=message):
            read_yaml(tmp_path / name)


def test_writes_what_it_reads():
    data = {"on": "1e3", "a": 1e-9, "b": [1, 2.5, True, None], "c": {"d": "yes 1"}}
    assert parse_yaml(write_yaml(data), "x") == data


TEXTS = (
    *("1e-3", "010", "1:30", "on", "null", "~", "-.5", " ", " led", "- a", "a: b"),
    *("#x", "a #b", "'q'", '"q"', "two\nlines", "a\tb", "*x", "&x", "{x", "[x", "? x"),
    *("é µ 漢字", "word " * 60, "body 0 (door.left)", "wheel/tyre*/#2", "<<", "="),
)


def test_libyaml_writes_what_python_writes():
    """The dumper that is there against PyYAML's own, with the same words of YAML."""

    class PythonDumper(yaml.SafeDumper):
        yaml_implicit_resolvers = strict_yaml._Dumper.yaml_implicit_resolvers

        def ignore_aliases(self, data):
            return True

    same = {"size": [0.1, 1e-9, float("inf")], "is": (True, None), "no": {}, "nor": []}
    data = {"texts": ["", *TEXTS], "by": dict.fromkeys(TEXTS, same), "last": same}
    written = write_yaml(data)
    assert written == yaml.dump(
        data, Dumper=PythonDumper, sort_keys=False, allow_unicode=True
    )
    read = parse_yaml(written, "x")
    assert read["texts"] == ["", *TEXTS]
    assert list(read["by"]) == list(TEXTS)
    line = {"match": ["wheel*"] * 50, "ignore": True}
    assert "\n" not in write_flow(line)
    assert parse_yaml(write_flow(line), "x") == line
