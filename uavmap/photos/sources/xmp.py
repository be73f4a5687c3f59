"""XMP packets of photographs: their values by local name, in any maker's namespace.

DJI, Autel, Parrot and Pix4D write the same words (RelativeAltitude, GimbalYawDegree, Yaw) under
namespaces that change from model to model; no word that is read here has two meanings.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from xml.etree.ElementTree import ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

LARGEST_PACKET = 2 * 2**20

Values = Mapping[str, str]


def values_of(packet: bytes | str) -> dict[str, str]:
    """Return attributes and text elements by their local names; the first of a name counts.

    Raises `ValueError` for what is not well-formed, too long, or declares entities.

    >>> values_of('<a xmlns:d="http://d/" d:Yaw="4"><d:Pitch> -90 </d:Pitch></a>')
    {'Yaw': '4', 'Pitch': '-90'}
    """
    if len(packet) > LARGEST_PACKET:
        raise ValueError(f"{len(packet)} bytes are too many")
    text = packet.decode("utf-8", "replace") if isinstance(packet, bytes) else packet
    text = text.strip("\0 \r\n\t\ufeff")
    if not text:
        return {}
    try:
        root = fromstring(text, forbid_dtd=True)
    except DefusedXmlException:
        raise ValueError("it declares entities") from None
    except (ParseError, LookupError) as error:
        raise ValueError(str(error)) from None
    values: dict[str, str] = {}
    for element in root.iter():
        for key, value in element.attrib.items():
            values.setdefault(_local(key), value.strip())
        if element.text and element.text.strip():
            values.setdefault(_local(element.tag), element.text.strip())
    return values


def number(values: Values, key: str) -> float | None:
    """Return the number under a key, None if absent. Raises `ValueError` for anything else.

    >>> number({"RelativeAltitude": "+39.80"}, "RelativeAltitude")
    39.8
    """
    if key not in values:
        return None
    text = values[key]
    try:
        # rationals, as EXIF in XMP has them
        over, _, under = text.partition("/")
        value = float(over) / float(under) if under else float(over)
    except (ValueError, ZeroDivisionError):
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"XMP {key} is {text[:40]!r}: not a number")
    return value


def _local(name: str) -> str:
    return name.rpartition("}")[2]
