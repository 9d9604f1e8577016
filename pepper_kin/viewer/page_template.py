"""Pages as one text: a template of the folder `page` with its styles, its scripts and meshcat's script."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

from pepper_kin.viewer.drawing import meshcat_bundle


@cache
def _parts(name: str, scripts: tuple[str, ...]) -> dict[str, str]:
    """Return the texts for the placeholders that all pages of a template share."""
    folder = files("pepper_kin.viewer") / "page"

    def text(*names: str) -> str:
        return "\n".join((folder / file).read_text(encoding="utf-8") for file in names)

    return {
        "template": text(f"{name}.html"),
        "style": text("common.css", f"{name}.css"),
        # The code must not end its own script element: in strings and patterns `<\/` means `</`.
        "meshcat": meshcat_bundle().replace("</script", "<\\/script").replace("<!--", "<\\!--"),
        "scripts": text(*scripts),
    }


def filled_page(name: str, scripts: tuple[str, ...], **more: str) -> str:
    """Return the text of a page.

    Args:
        name: Name of the template and the style.
        scripts: Files of the page's code, in order.
        more: Texts for the template's other placeholders, escaped as needed there.
    """
    parts = {**_parts(name, scripts), **more}
    first, *rest = parts["template"].split("{{")
    filled = [first]
    for part in rest:
        place, after = part.split("}}", 1)
        filled += [parts[place], after]
    return "".join(filled)
