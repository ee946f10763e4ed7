"""An SVG as a page holds it: squeezed, and as the text of an image's address, for a page of many pictures must stay small.

Coordinates keep a hundredth of a point, and clouds of points, which are pictures inside the picture, 64 tones; what is no picture
(comments, which hold users' texts, and metadata) is left out.
"""

import base64
import io
import re

from markupsafe import Markup


_NO_PICTURE = re.compile(r"<\?xml.*?\?>|<!DOCTYPE.*?>|<!--.*?-->|<metadata>.*?</metadata>", re.DOTALL)
_PLACES = re.compile(r'(?<=\s)(d|x|y|x1|x2|y1|y2)="([^"]*)"')
_NUMBER = re.compile(r"-?\d+\.\d{3,}")
_BETWEEN = re.compile(r">\s+<")
_SPACE = re.compile(r"\s+")
_INSIDE = re.compile(r"(?<=data:image/png;base64,)[A-Za-z0-9+/=\s]+")
SMALL = 8_000  # bytes of a picture inside that is left as it is: maps, whose tones say something
TONES = 64
# Of an address within quotation marks: what would end it, what begins a fragment, what HTML reads in its own way.
_ESCAPES = {"%": "%25", "#": "%23", '"': "'", "<": "%3C", ">": "%3E", "&": "%26"}


def address(svg: bytes) -> Markup:
    """ "data:image/svg+xml,..." for the src of an image."""
    text = _NO_PICTURE.sub("", svg.decode("utf-8"))
    text = _PLACES.sub(lambda found: f'{found[1]}="{_NUMBER.sub(_short, found[2])}"', text)
    text = _INSIDE.sub(lambda found: _fewer_tones(found[0]), text)
    text = _SPACE.sub(" ", _BETWEEN.sub("><", text)).strip()
    escapes = _ESCAPES if "'" not in text else _ESCAPES | {'"': "%22"}
    return Markup("data:image/svg+xml," + text.translate(str.maketrans(escapes)))


def _fewer_tones(encoded: str) -> str:
    from PIL import Image

    png = base64.b64decode(encoded)
    if len(png) < SMALL:
        return encoded
    out = io.BytesIO()
    with Image.open(io.BytesIO(png)) as cloud:
        small = cloud.convert("RGBA").quantize(TONES, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
        small.save(out, "PNG", optimize=True)
    return base64.b64encode(min(out.getvalue(), png, key=len)).decode("ascii")


def _short(found: re.Match[str]) -> str:
    short = f"{float(found[0]):.2f}".rstrip("0").rstrip(".")
    return "0" if short == "-0" else short
