"""Role of a coloured word: what kind of a limit or decision an entry is."""

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxRole


TAGS = ("physical", "numerical", "convenience")


class _Tag(SphinxRole):
    def run(self):
        if self.text not in TAGS:
            message = self.inliner.reporter.error(f"tag: choose {', '.join(TAGS)}")
            return [], [message]
        classes = ["tag", f"tag-{self.text}"]
        return [nodes.inline(self.rawtext, self.text, classes=classes)], []


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_role("tag", _Tag())
    return {"parallel_read_safe": True, "parallel_write_safe": True}
