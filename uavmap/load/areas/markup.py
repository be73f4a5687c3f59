"""XML of unknown origin: parsed without document types, entities or anything from outside."""

from __future__ import annotations

from typing import Final
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from missions.errors import AreaError
from uavmap.base.printable import printable

_ELSEWHERE: Final = {
    "osm": "data of OpenStreetMap; export it as GeoJSON, as overpass turbo does",
    "FeatureCollection": "GML; export it as GeoJSON",
    "TrainingCenterDatabase": "a training of Garmin; export it as GPX",
    "qgis": "a project of QGIS, which holds no shapes; export the layer as GeoJSON",
    "ugcs-Transfer": "a mission of UgCS; export its route as KML",
}
"""XML that people have at hand, by its root."""


def root_of(data: bytes, source: str) -> Element:
    """The root of an XML document. Raises `AreaError`."""
    try:
        root = fromstring(data, forbid_dtd=True)
    except DefusedXmlException:
        raise AreaError(
            f"{source}: XML with a document type or entities, which no KML has; save it anew"
        ) from None
    except (ParseError, ValueError, LookupError) as error:
        raise AreaError(
            f"{source}: not well-formed XML ({printable(str(error), 80)}); save it anew as KML"
        ) from None
    if not isinstance(root, Element):
        raise AreaError(f"{source}: XML without an element; save it anew as KML")
    return root


def local(element: Element) -> str:
    """The name of an element without its namespace, which differs from tool to tool."""
    tag = element.tag
    return tag.rpartition("}")[2] if isinstance(tag, str) else ""


def text_of(element: Element, name: str) -> str | None:
    """The text of the first child of this name."""
    return next((child.text for child in element if local(child) == name), None)


def refused(root: Element, source: str) -> AreaError:
    """What to say of XML that is neither KML nor GPX."""
    name = local(root)
    if name in _ELSEWHERE:
        return AreaError(f"{source}: {_ELSEWHERE[name]}")
    return AreaError(
        f"{source}: XML, but no KML and no GPX: its root is {printable(name, 40)!r}; save the "
        "polygon as KML"
    )
