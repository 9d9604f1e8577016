"""Pages as one text: a template of the folder `page` with its styles, its scripts and meshcat's."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

from pepper_kin.viewer.drawing import meshcat_bundle


@cache
def _parts(name: str, scripts: tuple[str, ...]) -> dict[str, str]:
    folder = files("pepper_kin.viewer") / "page"

    def text(*names: str) -> str:
        return "\n".join((folder / file).read_text(encoding="utf-8") for file in names)

    return {
        "template": text(f"{name}.html"),
        "style": text("common.css", f"{name}.css"),
        # Code that cannot end its own script element: in strings and patterns `<\/` means `</`.
        "meshcat": meshcat_bundle().replace("</script", "<\\/script").replace("<!--", "<\\!--"),
        "scripts": text(*scripts),
    }


def filled_page(name: str, scripts: tuple[str, ...], **more: str) -> str:
    """Return a page.

    Args:
        name: Of its template and its style.
        scripts: Files of its code, in order.
        more: What else the template names, escaped for the place where it lands.
    """
    parts = {**_parts(name, scripts), **more}
    first, *rest = parts["template"].split("{{")
    filled = [first]
    for part in rest:
        place, after = part.split("}}", 1)
        filled += [parts[place], after]
    return "".join(filled)
