"""The flight's side of a page's or a link's process."""

import pytest

from missions.errors import OutputError
from uavmap.ui.page.feed import Feed


def test_report_that_comes_with_the_first_line_is_kept():
    feed = Feed("tests.support.page.prompt_child", "the link", {})
    feed.wait_ready()
    assert feed.close() == [{"report": "no link yet"}]


def test_reason_of_a_process_that_has_ended_already_is_shown():
    feed = Feed("tests.support.page.failing_child", "the link", {})
    feed._child.process.wait()
    with pytest.raises(OutputError, match="the link does not start: no certificate"):
        feed.wait_ready()
    feed.close()
