import html
import json
import re
from collections.abc import Mapping, Sequence

from jaxthermo.report.templates import Html


_MARK = re.compile(
    r'<path ([^>]*?aria-label="([^"]*)"[^>]*?)><title>.*?</title></path>'
)

_STYLE = """<style>
#tip { position: absolute; display: none; z-index: 9; max-width: 26rem;
  background: #fff; border: 1px solid #c8ccd4; border-radius: 4px; padding: .5rem .7rem;
  box-shadow: 0 2px 10px rgba(20, 23, 29, .18); font-size: 13px; pointer-events: none; }
#tip img { margin: .3rem 0 0; }
[data-tip] { cursor: pointer; }
[data-tip]:hover { stroke: #14171d; stroke-width: 2.5; }
</style>"""

# Pictures are in the page once, in the table that the script reads.
_SCRIPT = """<div id="tip"></div><script>
const tips = TABLE;
const box = document.getElementById("tip");
for (const mark of document.querySelectorAll("[data-tip]")) {
  for (const title of mark.querySelectorAll("title")) title.remove();
  mark.addEventListener("mousemove", event => {
    const [text, picture] = tips[mark.dataset.tip];
    box.textContent = text;
    if (picture) {
      const image = document.createElement("img");
      image.src = "data:image/png;base64," + picture;
      box.append(image);
    }
    box.style.display = "block";
    const right = event.pageX + 16 + box.offsetWidth < document.body.offsetWidth + 200;
    box.style.left = (right ? event.pageX + 14 : event.pageX - 14 - box.offsetWidth)
      + "px";
    box.style.top = event.pageY + 14 + "px";
  });
  mark.addEventListener("mouseleave", () => { box.style.display = "none"; });
}
</script>"""


def numbered(chart: Html, texts: Sequence[str]) -> Html:
    """Chart whose marks with one of the texts have the number of its tooltip.

    Without the script the browser shows the text alone.
    """
    number = {text: n for n, text in enumerate(texts)}

    def marked(path: re.Match[str]) -> str:
        tip = number.get(html.unescape(path[2]))
        if tip is None:
            return path[0]
        return path[0].replace("<path ", f'<path data-tip="{tip}" ', 1)

    return Html(_MARK.sub(marked, chart))


def tooltips(texts: Sequence[str], pictures: Mapping[str, str]) -> Html:
    """Style, texts, pictures (base64 of PNG, by text) and script of all tooltips."""
    table = json.dumps([[text, pictures.get(text)] for text in texts])
    # "</" would end the script inside a text.
    return Html(_STYLE + _SCRIPT.replace("TABLE", table.replace("</", "<\\/")))
