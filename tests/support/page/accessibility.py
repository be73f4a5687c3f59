"""Accessibility of a page: names of controls, contrast, keys and a visible focus.

Elements behind an open dialog do not count: it takes all keys.
"""

from __future__ import annotations

from typing import Any

MIN_CONTRAST = 4.5
_ROLES = {"button", "link", "textbox", "combobox", "checkbox", "spinbutton", "slider", "switch",
          "tab", "radio", "image", "searchbox", "Iframe", "dialog", "alert dialog"}  # fmt: skip

_SHOWN = """
const shown = (e) => {
  if (!e.getClientRects().length || e.closest('[inert]')) return false;
  for (let a = e; a; a = a.parentElement) {
    const style = getComputedStyle(a);
    if (style.visibility === 'hidden' || Number(style.opacity) === 0) return false;
  }
  return true;
};
const modal = () =>
  [...document.querySelectorAll('[aria-modal="true"]')].filter(shown).at(-1) || document;
const able = (e) => !e.disabled && !e.closest('.disabled, .leaflet-disabled, [aria-disabled=true]');
"""
_CONTRAST = (
    _SHOWN
    + """
const parts = (css) => {
  const n = css.match(/[\\d.]+/g).map(Number);
  return [n[0], n[1], n[2], n.length > 3 ? n[3] : 1];
};
const over = ([r, g, b, a], under) =>
  [...[r, g, b].map((v, i) => v * a + under[i] * (1 - a)), 1];
const light = ([r, g, b]) => {
  const linear = (v) => (v /= 255) <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
  const [x, y, z] = [r, g, b].map(linear);
  return 0.2126 * x + 0.7152 * y + 0.0722 * z;
};
const behind = (e) => {
  const layers = [];
  for (let a = e; a; a = a.parentElement) {
    layers.push(parts(getComputedStyle(a).backgroundColor));
    if (layers.at(-1)[3] === 1) break;
  }
  return layers.reverse().reduce((under, layer) => over(layer, under), [255, 255, 255, 1]);
};
const faded = ([r, g, b, a], e) => {
  for (let up = e; up; up = up.parentElement) a *= Number(getComputedStyle(up).opacity);
  return [r, g, b, a];
};
const poor = [];
const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
while (walk.nextNode()) {
  const e = walk.currentNode.parentElement, text = walk.currentNode.data.trim();
  if (!text || /^(SCRIPT|STYLE|NOSCRIPT|TEMPLATE)$/.test(e.tagName)) continue;
  if (!shown(e) || !able(e) || !modal().contains(e)) continue;
  const under = behind(e), ink = over(faded(parts(getComputedStyle(e).color), e), under);
  const [a, b] = [light(ink), light(under)];
  const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
  if (ratio < arguments[0]) poor.push(`${text.slice(0, 40)}: ${ratio.toFixed(2)}`);
}
return poor;
"""
)
_CONTROLS = (
    _SHOWN
    + """
const all = document.querySelectorAll(
  'button, a[href], input:not([type=file]), select, textarea, [tabindex="0"], iframe');
return [...all].filter((e) => e.tabIndex >= 0 && shown(e) && able(e) && modal().contains(e));
"""
)
_SETTLED = """
const end = (one) => one.effect.getComputedTiming().endTime;
const brief = () => document.getAnimations().filter((one) => end(one) !== Infinity);
const settled = () => Promise.all(brief().map((one) => one.finished.catch(() => null)));
const [done] = arguments;
requestAnimationFrame(() => requestAnimationFrame(() => settled().then(() => done())));
"""
"""Waits until what fades in is there, a dialog for one."""
_WIDE = (
    _SHOWN
    + """
const scrolls = (e) => /auto|scroll/.test(getComputedStyle(e).overflowX) || e === document.body;
return [...document.querySelectorAll('body, body *')].filter(
  (e) => shown(e) && scrolls(e) && e.scrollWidth > e.clientWidth + 1,
).map((e) => `${e.scrollWidth} px wide in ${e.clientWidth} px: ${e.tagName} ${e.className}`);
"""
)
_FOCUSED = """
const e = document.activeElement, field = e.closest('.q-field');
const style = getComputedStyle(e);
const outlined = style.outlineStyle !== 'none' && parseFloat(style.outlineWidth) >= 2;
const marked = outlined || style.boxShadow !== 'none';
return [e, marked || !!field?.classList.contains('q-field--focused') || e.tagName === 'IFRAME'];
"""


def faults(driver: Any) -> list[str]:
    """Return the obstacles to the use of the page as it is shown now; empty if there are none."""
    driver.execute_async_script(_SETTLED)
    told = driver.execute_script("return [document.documentElement.lang, document.title]")
    unnamed = [
        f"the page has no {what}"
        for what, text in zip(("language", "title"), told, strict=True)
        if not text
    ]
    return [
        *unnamed,
        *without_names(driver),
        *too_pale(driver),
        *out_of_reach(driver),
        *too_wide(driver),
    ]


def too_wide(driver: Any) -> list[str]:
    """Return the page if it is wider than its window, and parts that are scrolled sideways."""
    found: list[str] = driver.execute_script(_WIDE)
    return found


def without_names(driver: Any) -> list[str]:
    """Return the controls and pictures without a name in the browser's accessibility tree."""
    nodes = driver.execute_cdp_cmd("Accessibility.getFullAXTree", {})["nodes"]
    return [
        f"{node['role']['value']} {node.get('backendDOMNodeId')}"
        for node in nodes
        if not node.get("ignored")
        and node["role"]["value"] in _ROLES
        and not node.get("name", {}).get("value", "").strip()
    ]


def too_pale(driver: Any) -> list[str]:
    """Return texts with too little contrast to their background."""
    found: list[str] = driver.execute_script(_CONTRAST, MIN_CONTRAST)
    return found


def out_of_reach(driver: Any) -> list[str]:
    """Return controls that the tab key does not reach, or without a visible focus."""
    from selenium.webdriver import ActionChains, Keys  # noqa: PLC0415 - it may be missing

    wanted = {e.id: e for e in driver.execute_script(_CONTROLS)}
    driver.execute_script("document.activeElement.blur(); window.getSelection().empty()")
    seen: set[str] = set()
    unmarked = []
    for _ in range(2 * len(wanted) + 4):
        ActionChains(driver).send_keys(Keys.TAB).perform()
        focused, marked = driver.execute_script(_FOCUSED)
        if focused.id in seen:
            break
        seen.add(focused.id)
        if not marked and focused.id in wanted:
            unmarked.append(f"focus is not seen: {_named(focused)}")
    left = [_named(e) for id_, e in wanted.items() if id_ not in seen]
    return [f"out of reach: {name}" for name in left if name] + unmarked


def _named(element: Any) -> str:
    from selenium.common.exceptions import StaleElementReferenceException  # noqa: PLC0415

    try:
        return str(element.get_attribute("outerHTML"))[:160]
    except StaleElementReferenceException:  # it is gone by now
        return ""
