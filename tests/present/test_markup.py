"""Text from vehicles, logs and file names becomes neither markup nor a control character."""

from __future__ import annotations

from companion.present import text


def test_what_is_not_printable_is_seen_to_be_there() -> None:
    assert text("a\x1b[31m\u202e") == "a\N{REPLACEMENT CHARACTER}[31m\N{REPLACEMENT CHARACTER}"


def test_a_number_stays_with_its_unit() -> None:
    assert text("0.2\N{NO-BREAK SPACE}m,\nand more") == "0.2\N{NO-BREAK SPACE}m,\nand more"


def test_nothing_is_markup() -> None:
    assert text('<b a="1">&') == "&lt;b a=&quot;1&quot;&gt;&amp;"
