"""The flight's side of a page's or a link's process."""

from uavmap.ui.page.feed import Feed


def test_report_that_comes_with_the_first_line_is_kept():
    feed = Feed("tests.support.page.prompt_child", "the link", {})
    feed.wait_ready()
    assert feed.close() == [{"report": "no link yet"}]
