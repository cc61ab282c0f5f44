"""`jaxthermo example`: the shipped scenes that need no mesh file."""

import re
import sys
from itertools import takewhile
from pathlib import Path

from ..atomic import write_text
from ..config.messages import close_match
from ..config.strict_yaml import parse_yaml
from ..errors import InputError


_PACKAGE = Path(__file__).parents[1]
# A wheel has the scenes in the package, a source tree only in configs/.
_FOLDERS = (_PACKAGE / "scenes", _PACKAGE.parent / "configs" / "scenes")


def example(name: str | None, out: Path | None) -> None:
    """List the examples, print one, or write it to a file.

    Raises:
        InputError: for an unknown name, or a file that exists or cannot be written.
    """
    texts = _examples()
    if name is None:
        if out is not None:
            raise InputError(f"--out {out}: name the example that is to be written")
        width = max(map(len, texts))
        for example_name, text in texts.items():
            sys.stdout.write(f"{example_name:{width}}  {_title(text)}\n")
        return
    if name not in texts:
        raise InputError(f"there is no example '{name}'{close_match(name, texts)}")
    if out is None:
        sys.stdout.write(texts[name])
        return
    if out.exists():
        raise InputError(f"--out {out}: exists already; name another file")
    write_text(out, texts[name])
    sys.stdout.write(f"{out}\n")


def _examples() -> dict[str, str]:
    # Scenes of mesh files are left out: the files are not part of the package.
    folder = next((folder for folder in _FOLDERS if folder.is_dir()), None)
    if folder is None:
        raise InputError("no examples are installed: reinstall jaxthermo")
    texts = {}
    for path in sorted(folder.glob("*.yaml")):
        text = path.read_text(encoding="utf-8")
        bodies = parse_yaml(text, str(path))["bodies"]
        if not any("mesh" in body for body in bodies):
            # The first line names a schema by a path that only the repository has.
            texts[path.stem] = re.sub(r"\A# yaml-language-server.*\n", "", text)
    return texts


# The first clause of the comment at the top of a scene.
def _title(text: str) -> str:
    lines = takewhile(lambda line: line.startswith("#"), text.splitlines())
    words = " ".join(line.strip("# ") for line in lines)
    return re.split(r"[.:] ", words)[0].rstrip(".") + "."
