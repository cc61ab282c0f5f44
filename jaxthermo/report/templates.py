"""Templates of the HTML pages: text is escaped, only `Html` is taken as it is."""

import html
import re

from jinja2 import DictLoader, Environment, StrictUndefined


STYLE = """
:root { color-scheme: light dark; --ink: #20242c; --page: #fff; --muted: #5a606c;
  --line: #e2e5ea; --rule: #c8ccd4; --panel: #f4f5f7; --link: #1a5fb4;
  --met: #1b7a4a; --missed: #b3261e; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #dfe2e8; --page: #16181d; --muted: #9aa1ae; --line: #2d313a;
    --rule: #454b57; --panel: #20232a; --link: #7db4ff; --met: #5cc48d;
    --missed: #ff8a80; }
}
body { font: 15px/1.5 system-ui, sans-serif; color: var(--ink); margin: 2rem auto;
  max-width: 1240px; padding: 0 1.2rem; background: var(--page); }
h1 { font-size: 1.6rem; margin-bottom: .3rem; } h2 { margin-top: 2.6rem; }
p, li { max-width: 60rem; } .note { color: var(--muted); }
table { border-collapse: collapse; font-variant-numeric: tabular-nums;
  font-size: 13px; margin: 1rem 0; }
th, td { padding: .28rem .6rem; text-align: right; white-space: nowrap;
  border-bottom: 1px solid var(--line); }
th { font-weight: 600; border-bottom: 2px solid var(--rule); vertical-align: bottom; }
td.left, th.left { text-align: left; }
td.words { white-space: normal; text-align: left; min-width: 14rem; }
td.heading { font-weight: 600; background: var(--panel); padding-top: .7rem; }
.wide { overflow-x: auto; }
.met { color: var(--met); } .missed { color: var(--missed); font-weight: 600; }
img, svg { max-width: 100%; height: auto; display: block; margin: 1rem 0; }
pre { background: var(--panel); padding: 1rem; overflow-x: auto; font-size: 12px; }
summary { cursor: pointer; margin: 1rem 0; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .2rem 1.2rem;
  max-width: 60rem; font-size: 14px; color: var(--muted); }
dt { font-weight: 600; } dd { margin: 0; }
.cards { display: grid; gap: 1rem; grid-template-columns: repeat(auto-fill,
  minmax(24rem, 1fr)); }
.card { border: 1px solid var(--line); border-radius: 6px; padding: .8rem 1rem;
  display: flex; gap: 1rem; min-width: 0; }
.card img { width: 112px; margin: 0; align-self: flex-start; border-radius: 3px; }
.card div { min-width: 0; } .card h3 { margin: 0; font-size: 1rem; }
.card p { margin: .25rem 0 0; font-size: 13px; overflow-wrap: anywhere; }
a { color: var(--link); } code { font-size: .92em; background: var(--panel); }
"""

_TEMPLATES = {
    "document": """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<title>{{ title }}</title><style>{{ style }}</style></head>
<body><h1>{{ title }}</h1>
{% for section in sections %}{{ section }}
{% endfor %}</body></html>
""",
    "table": """<div class="wide"><table><thead><tr>
{%- for name in table.columns %}
<th{% if loop.index0 in table.left %} class="left"{% endif %}>{{ name }}</th>
{%- endfor %}</tr></thead>
<tbody>{% for row in rows %}<tr>{% for cell in row -%}
<td{% if cell.html_class %} class="{{ cell.html_class }}"{% endif %}
{%- if cell.columns > 1 %} colspan="{{ cell.columns }}"{% endif %}>
{%- for line in cell.text.split("\\n") -%}
{% if cell.links %}<a href="#{{ line }}">{{ line }}</a>{% else %}{{ line | with_code }}
{%- endif %}{% if not loop.last %}<br>{% endif %}
{%- endfor %}</td>{% endfor %}</tr>
{% endfor %}</tbody></table></div>""",
    "terms": """<dl>{% for word, meaning in pairs -%}
<dt>{{ word }}</dt><dd>{{ meaning | with_code }}</dd>
{% endfor %}</dl>""",
    "heading": """<h{{ level }}{% if anchor %} id="{{ anchor }}"{% endif %}>
{{- text }}</h{{ level }}>""",
    "paragraph": "<p{% if note %} class=note{% endif %}>{{ text | with_code }}</p>",
    "details": """<details><summary>{{ title }}</summary>
{{ content }}</details>""",
    "pre": "<pre>{{ text }}</pre>",
    "cards": """<div class="cards">{% for card in cards -%}
<div class="card">{% if card.picture %}<img alt="" src="data:image/png;base64,
{{- card.picture }}">{% endif %}<div><h3>
{%- if card.link %}<a href="{{ card.link }}">{{ card.title }}</a>
{%- else %}{{ card.title }}{% endif %}</h3>
{% for line in card.lines %}<p>{{ line }}</p>
{% endfor %}{% for line in card.notes %}<p class="note">{{ line }}</p>
{% endfor %}</div></div>
{% endfor %}</div>""",
    "image": '<img alt="{{ alt }}" src="data:image/png;base64,{{ data }}">',
}

_ENVIRONMENT = Environment(
    loader=DictLoader(_TEMPLATES),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=False,
)


class Html(str):
    """Markup that a template inserts without escaping."""

    def __html__(self) -> "Html":
        """The markup itself; by this method jinja2 recognizes it."""
        return self


def _with_code(text: str) -> Html:
    """Escaped text; words between backticks are in a fixed-width font."""
    return Html(re.sub(r"`([^`]+)`", r"<code>\1</code>", html.escape(text)))


_ENVIRONMENT.filters["with_code"] = _with_code


def render(template: str, **values: object) -> Html:
    """Fill in one of the templates."""
    return Html(_ENVIRONMENT.get_template(template).render(**values))
