"""Bytes of a SCPI link cut into commands and answers: nothing is lost, and nothing raises."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from belahil.scpi_text import Block, error_entry, fields, read_field, text_difference, units

WORDS = st.text("ABC:*?,.+-0123 ", min_size=1, max_size=12).map(str.strip).filter(bool)
ANSWERS = st.text('ABC:,.+-0123 "', min_size=1, max_size=12).filter(
    lambda text: text.count('"') % 2 == 0 and text.strip()
)


@given(st.binary(max_size=200))
def test_any_bytes_are_cut(message: bytes) -> None:
    # given any bytes at all, when they are taken for a message and for an answer, then both are told
    for unit in units(message):
        assert unit == unit.strip() != ""
    assert fields(message, 1) is not None
    read = read_field(message)
    assert str(read) is not None
    if isinstance(read, Block):
        assert read.data in message


@given(st.lists(WORDS, min_size=1, max_size=6), st.binary(max_size=60))
def test_commands_with_a_block_between_are_all_found(commands: list[str], data: bytes) -> None:
    # given commands, one with a block that may hold semicolons and line feeds
    head = f"#{len(str(len(data)))}{len(data)}"
    message = ";".join(commands).encode() + b";DATA X," + head.encode() + data + b";*OPC?\n"
    # then each is a unit, and of the block only the length is told
    assert units(message) == [*commands, f"DATA X,{head}<{len(data)} bytes>", "*OPC?"]


@given(st.lists(ANSWERS, min_size=2, max_size=6))
def test_answers_are_cut_where_their_questions_were(answers: list[str]) -> None:
    message = ";".join(answers).encode() + b"\n"
    assert fields(message, len(answers)) == [answer.encode() for answer in answers]
    assert fields(message, len(answers) + 1) is None


@given(st.binary(max_size=60), st.sampled_from(["", "DAT2,"]))
def test_a_block_is_read_with_what_stands_before_it(data: bytes, before: str) -> None:
    head = f"#9{len(data):09d}"
    assert read_field(before.encode() + head.encode() + data) == Block(before, head, data)


@given(st.floats(allow_nan=False, allow_infinity=False, min_value=-1e12, max_value=1e12))
def test_the_same_number_written_otherwise_is_a_matter_of_format(number: float) -> None:
    assert text_difference(f"A {number:+.16E}V", f"A {number!r}V") in ("format", None)
    assert text_difference(f"A {number!r}V", f"A {number + abs(number) / 7 + 1!r}V") == "number"
    assert text_difference(f"A {number!r}V", f"B {number!r}V") == "text"


def test_entries_of_an_error_queue() -> None:
    assert error_entry('+0,"No error"') == (0, "No error")
    assert error_entry('-222 , "Out of range;said "twice""') == (-222, 'Out of range;said "twice"')
    assert error_entry("0") is None
