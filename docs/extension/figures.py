"""Pictures with captions: an image alone in a paragraph shows its text below it."""

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms import SphinxTransform


class _Captions(SphinxTransform):
    """Before images are collected; elsewhere Markdown shows the text of none."""

    default_priority = 200

    def apply(self, **kwargs: object) -> None:
        for paragraph in list(self.document.findall(nodes.paragraph)):
            picture = paragraph.children[0] if len(paragraph) == 1 else None
            if isinstance(picture, nodes.image):
                caption = nodes.caption("", picture.get("alt", ""))
                paragraph.replace_self(nodes.figure("", picture, caption))


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_transform(_Captions)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
