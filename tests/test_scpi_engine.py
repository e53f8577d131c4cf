"""The SCPI engine, rule by rule: framing, headers, numbers, parameters, errors, status."""

from __future__ import annotations

import itertools
import math
import re
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.devices.scpi import ScpiDevice
from sim.devices.scpi.framing import BLOCK_MARK, Framer, Message
from sim.devices.scpi.numeric import (
    AMPLITUDE,
    HERTZ,
    OHM,
    SECOND,
    Quantity,
    Units,
    answer_number,
    read_number,
)
from sim.devices.scpi.parameters import (
    Choices,
    read_block,
    read_boolean,
    read_integer,
    read_name,
    read_within,
)
from sim.devices.scpi.parser import Token, Unit, parse
from sim.devices.scpi.status import ScpiError, event_bit
from sim.devices.scpi.tree import Action, Call, HeaderTree

PATTERNS = (
    "[SOURce#:]FREQuency[:CW]",
    "[SOURce#:]VOLTage[:LEVel][:IMMediate][:AMPLitude]",
    "[SOURce#:]VOLTage[:LEVel][:IMMediate]:OFFSet",
    "[SOURce#:]VOLTage:UNIT",
    "OUTPut#[:STATe]",
    "OUTPut#:LOAD",
    "TRIGger#:SOURce",
)


class Toy(ScpiDevice):
    """Remembers what it was told."""

    def __init__(self) -> None:
        super().__init__("Maker,Toy,0,1", channels=2)
        self.log: list[str] = []
        for pattern in PATTERNS:
            self.tree.add(pattern, self._note(pattern), self._tell(pattern))
        self.tree.add("DATA:ARBitrary", Action(self._data, 2, 2))
        self.tree.add("FAULt", Action(self._fault, 1, 1))

    def _note(self, pattern: str) -> Action:
        def run(call: Call) -> None:
            self.log.append(f"{pattern} {call.suffixes} {[token.text for token in call.parameters]}")

        return Action(run, 0, 3)

    def _tell(self, pattern: str) -> Action:
        return Action(lambda call: f"{pattern.count(':')}{call.suffixes}", 0, 1)

    def _data(self, call: Call) -> None:
        self.log.append(f"{read_name(call.parameters[0])} {read_block(call.parameters[1])!r}")

    def _fault(self, call: Call) -> None:
        raise ScpiError(read_integer(call.parameters[0], -999, 999))


def ask(device: ScpiDevice, text: str) -> list[bytes]:
    device.write(text.encode("latin-1") + b"\n")
    return answers(device)


def answers(device: ScpiDevice) -> list[bytes]:
    return list(iter(device.read, None))


def errors(device: ScpiDevice) -> list[int]:
    found = []
    while (code := int(ask(device, "SYST:ERR?")[0].split(b",")[0])) != 0:
        found.append(code)
    return found


# Framing


def fed(framer: Framer, data: bytes, end: bool) -> list[Message]:
    return list(framer.feed(data, end))


def test_a_line_feed_or_end_completes_a_message() -> None:
    framer = Framer(1000)
    assert fed(framer, b"A 1\r\nB", end=False) == [Message("A 1\r")]
    assert fed(framer, b" 2", end=False) == []
    assert fed(framer, b"", end=True) == [Message("B 2")]
    assert fed(framer, b"C\n", end=True) == [Message("C")]


def test_a_block_may_hold_line_feeds_and_an_indefinite_one_lasts_until_end() -> None:
    framer = Framer(1000)
    assert fed(framer, b"D x,#14a\n;b;E\n", end=False) == [Message(f"D x,{BLOCK_MARK};E", {4: b"a\n;b"})]
    assert fed(framer, b"D #0a\nb", end=False) == []
    assert fed(framer, b"c\n", end=True) == [Message(f"D {BLOCK_MARK}", {2: b"a\nbc"})]
    assert fed(framer, b"D #10\n", end=False) == [Message(f"D {BLOCK_MARK}", {2: b""})]


def test_an_indefinite_block_on_a_link_without_end_is_an_error_until_the_next_line_feed() -> None:
    # given a stream, on which no end would ever come
    toy = Toy()
    for piece in (b'DATA:ARB x,#0ab"', b',#19;\nDATA:ARB "', b'x",#12ab\n*IDN?\n'):
        toy.write(piece)
    # then that message alone is refused
    assert answers(toy) == [toy.identity.encode() + b"\n"]
    assert errors(toy) == [-161]
    assert toy.log == ["x b'ab'"]


@pytest.mark.parametrize("piece", [b"D #3\n", b"D #3xyz\n", b"D #2a1b\n", b"D #19abc", b"D #", b"D #4123"])
def test_a_malformed_block_is_marked_with_its_error(piece: bytes) -> None:
    message = fed(Framer(1000), piece, end=True)[0]
    assert isinstance(message.blocks[2], ScpiError)
    assert message.blocks[2].code == -161


@pytest.mark.parametrize("text", [b'D "#14ab"', b"D#14abcd", b"D 5#14abcd", b"D #HFF"])
def test_a_hash_begins_a_block_only_where_a_parameter_begins(text: bytes) -> None:
    assert fed(Framer(1000), text + b"\n", end=False) == [Message(text.decode())]


def test_a_message_beyond_the_capacity_is_read_over_and_the_next_one_is_not() -> None:
    framer = Framer(50)
    for long in (b"A " + b"1" * 60, b"A #260" + b"\n" * 60, b"A #240" + b"\n" * 40 + b",#240" + b"\n" * 40):
        message, follower = fed(framer, long + b"\nB\n", end=False)
        assert isinstance(message.blocks[0], ScpiError)
        assert message.blocks[0].code == -363
        assert follower == Message("B")


@st.composite
def streams(draw: st.DrawFn) -> tuple[bytes, list[Message]]:
    """Messages with and without blocks, and what they must be taken apart into."""
    stream, expected = b"", []
    for _ in range(draw(st.integers(1, 4))):
        text, blocks = draw(st.sampled_from(["A", "FREQ", '"a;#b"'])), {}
        raw = text.encode()
        for _ in range(draw(st.integers(0, 3))):
            block = draw(st.binary(max_size=30))
            separator = draw(st.sampled_from([" ", ","]))
            length = f"{len(block):0{draw(st.integers(len(str(len(block))), 5))}d}"
            raw += f"{separator}#{len(length)}{length}".encode() + block
            text += separator
            blocks[len(text)] = block
            text += BLOCK_MARK
        stream += raw + b"\n"
        expected.append(Message(text, blocks))
    return stream, expected


@given(case=streams(), data=st.data())
def test_any_split_of_the_stream_gives_the_same_messages(
    case: tuple[bytes, list[Message]], data: st.DataObject
) -> None:
    stream, expected = case
    cuts = data.draw(st.lists(st.integers(0, len(stream)), max_size=8).map(sorted))
    framer = Framer(10_000)
    found = []
    for start, stop in itertools.pairwise([0, *cuts, len(stream)]):
        found += fed(framer, stream[start:stop], end=False)
    assert found == expected
    assert fed(framer, b"", end=True) == []


@given(
    stream=st.lists(
        st.sampled_from([b"#", b"1", b"0", b"3", b" ", b",", b"\n", b'"', b"'", b"A", b"\0"])
    ).map(b"".join),
    data=st.data(),
)
def test_any_split_of_garbage_gives_the_same_messages_too(stream: bytes, data: st.DataObject) -> None:
    cuts = data.draw(st.lists(st.integers(0, len(stream)), max_size=6).map(sorted))
    framer, whole = Framer(40), Framer(40)
    pieces = list(itertools.pairwise([0, *cuts, len(stream)]))
    found = [str(message) for a, b in pieces for message in fed(framer, stream[a:b], end=False)]
    found += map(str, fed(framer, b"", end=True))
    once = list(map(str, fed(whole, stream, end=False) + fed(whole, b"", end=True)))
    assert found == once


# Parsing


@pytest.mark.parametrize(
    ("text", "units"),
    [
        ("*RST", (Unit("*RST", ()),)),
        (" \tFREQ\t 1 , 2\r", (Unit("FREQ", (Token("number", "1"), Token("number", "2"))),)),
        ("A;B 1;", (Unit("A", ()), Unit("B", (Token("number", "1"),)))),
        ('A \'x;y\',"p,""q"', (Unit("A", (Token("string", "x;y"), Token("string", 'p,"q'))),)),
        ("A MAX", (Unit("A", (Token("character", "MAX"),)),)),
        ("A #HfF,#Q17,#B101", (Unit("A", tuple(Token("number", n) for n in ("255", "15", "5"))),)),
        ("A 1 MHZ", (Unit("A", (Token("number", "1 MHZ"),)),)),
        ("", ()),
        (" ; ", ()),
    ],
)
def test_a_message_is_taken_apart(text: str, units: tuple[Unit, ...]) -> None:
    assert parse(Message(text)) == units


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ('A "x', -151),
        ("A 1,,2", -102),
        ("A ,", -102),
        ("A \x80", -101),
        ("A $", -101),
        ("A (1)", -178),
        ("A B C", -103),
        ("A B:C", -141),
        ('A "x"y', -103),
        ("A #", -101),
        ("A #H", -101),
        ("A #X1", -101),
    ],
)
def test_a_malformed_parameter_ends_the_message_with_its_error(text: str, code: int) -> None:
    first, second = parse(Message("B 1;" + text + ";C"))
    assert first == Unit("B", (Token("number", "1"),))
    assert isinstance(second, ScpiError)
    assert second.code == code


# Headers


def as_regular_expression(pattern: str) -> str:
    """The obvious way: the pattern as a regular expression, with a suffix of 1 or 2 where it has a hash."""

    def node(match: re.Match[str]) -> str:
        short = re.sub("[a-z]", "", match[1])
        suffix = "[12]?" if match[2] else "1?"
        return f"(?:{short}|{match[1].upper()}){suffix}"

    text = pattern.replace("[", "(?:").replace("]", ")?")
    return ":?" + re.sub(r"([A-Z]+[a-z]*)(#)?", node, text)


NODES = sorted({node for pattern in PATTERNS for node in re.findall("[A-Za-z]+", pattern)})


@st.composite
def headers(draw: st.DrawFn) -> str:
    """Headers that are right, nearly right, and wrong."""
    nodes = re.findall("[A-Za-z]+", draw(st.sampled_from(PATTERNS)))
    if draw(st.booleans()):
        nodes = [node for node in nodes if draw(st.integers(0, 3))] or nodes
    if not draw(st.integers(0, 4)):
        nodes = draw(st.lists(st.sampled_from(NODES), min_size=1, max_size=4))
    parts = []
    for node in nodes:
        short = re.sub("[a-z]", "", node)
        form = draw(st.sampled_from([short, node, short, node, node[:-1], node + "S"]))
        suffix = draw(st.sampled_from(["", "", "", "1", "2"]))
        parts.append(draw(st.sampled_from([str.upper, str.lower, str.title]))(form) + suffix)
    return draw(st.sampled_from(["", ":"])) + ":".join(parts)


@given(header=headers())
def test_headers_match_exactly_where_an_independent_regular_expression_does(header: str) -> None:
    tree = HeaderTree(2)
    for pattern in PATTERNS:
        tree.add(pattern, Action(lambda call, name=pattern: name))
    right = [p for p in PATTERNS if re.fullmatch(as_regular_expression(p), header, re.IGNORECASE)]
    if right:
        assert tree.find(header, tree.root).action.run(Call((), ())) == right[0]
    else:
        with pytest.raises(ScpiError) as caught:
            tree.find(header, tree.root)
        assert caught.value.code in (-113, -114)


@pytest.mark.parametrize(
    ("header", "code"),
    [
        ("SOUR3:FREQ", -114),
        ("SOUR0:FREQ", -114),
        ("FREQ2", -114),
        ("FREQU", -113),
        ("FRE", -113),
        ("FREQ:CW:CW", -113),
        ("SOUR", -113),
        ("*XYZ", -113),
        ("ABCDEFGHIJKLM", -112),
        ("FREQ:", -102),
        ("FREQ,1", -102),
        ("1FREQ", -102),
        (":*IDN", -102),
        ("FR\xe9Q", -101),
        ("stra\xdfe", -101),
    ],
)
def test_a_header_that_is_not_there_has_its_own_error(header: str, code: int) -> None:
    toy = Toy()
    assert ask(toy, header + " 1") == []
    assert errors(toy) == [code]


def test_a_query_that_has_no_command_and_the_reverse_are_undefined() -> None:
    toy = Toy()
    ask(toy, "*IDN")
    ask(toy, "*RST?")
    ask(toy, "FAUL?")
    assert errors(toy) == [-113, -113, -113]


def test_the_suffix_of_a_node_that_was_left_out_is_one() -> None:
    toy = Toy()
    ask(toy, "FREQ 1;:SOUR2:FREQ 2;:SOURCE1:FREQUENCY:CW 3;:OUTP2 1;:OUTP 1")
    assert [line.split(" [")[0][-5:] for line in toy.log] == [" (1,)", " (2,)", " (1,)", " (2,)", " (1,)"]
    assert errors(toy) == []


def test_a_semicolon_continues_in_the_branch_and_common_commands_do_not_move_it() -> None:
    toy = Toy()
    ask(toy, "SOUR2:VOLT:UNIT VPP;OFFS 1;*WAI;UNIT VPP;LEV:OFFS 2;IMM:OFFS 3;:FREQ 5;VOLT 1")
    assert errors(toy) == []
    assert [line.split()[0] for line in toy.log] == [
        PATTERNS[3], PATTERNS[2], PATTERNS[3], PATTERNS[2], PATTERNS[2], PATTERNS[0], PATTERNS[1],
    ]  # fmt: skip
    assert ["(2,)" in line for line in toy.log] == [True] * 5 + [False] * 2
    # The root is not searched when the branch has no such node.
    ask(toy, "VOLT:UNIT VPP;FREQ 1")
    assert errors(toy) == [-113]


def test_several_queries_in_one_message_give_one_answer() -> None:
    toy = Toy()
    assert ask(toy, "*OPC?;:SYST:VERS?;*IDN?") == [b"1;1999.0;Maker,Toy,0,1\n"]
    assert ask(toy, "*OPC?\n*OPC?") == [b"1\n", b"1\n"]


# Numbers


@st.composite
def quantities(draw: st.DrawFn) -> tuple[str, Units | None, Fraction, str]:
    """The text of a number, its units, its exact value and its unit."""
    sign = draw(st.sampled_from(["", "+", "-"]))
    digits = draw(st.text("0123456789", min_size=1, max_size=20))
    point = draw(st.integers(0, len(digits)) | st.none())
    mantissa = digits if point is None else digits[:point] + "." + digits[point:]
    power = draw(st.none() | st.integers(-40, 15))
    blank = draw(st.sampled_from(["", " "]))
    text = sign + mantissa
    if power is not None:
        text += (
            f"{blank}{draw(st.sampled_from('eE'))}{blank}{power:{draw(st.sampled_from(['', '+', '03']))}d}"
        )
    multipliers = {"": 0, "k": 3, "u": -6, "n": -9, "MA": 6, "g": 9, "p": -12, "T": 12}
    units, unit, milli = draw(
        st.sampled_from([(HERTZ, "HZ", 6), (OHM, "OHM", 6), (SECOND, "S", -3), (AMPLITUDE, "VPP", -3)])
    )
    prefix, shift = draw(st.sampled_from([*multipliers.items(), ("m", milli), ("M", milli)]))
    if draw(st.booleans()):
        units, unit, shift = None, "", 0
    else:
        text += draw(st.sampled_from(["", " ", "  "])) + prefix + draw(st.sampled_from([unit, unit.lower()]))
    exact = Fraction(sign + digits) * Fraction(10) ** (
        (power or 0) + shift - (0 if point is None else len(digits) - point)
    )
    return text, units, exact, unit


@given(case=quantities())
def test_a_number_is_the_float_nearest_to_its_exact_value(
    case: tuple[str, Units | None, Fraction, str],
) -> None:
    text, units, exact, unit = case
    token = parse(Message("A " + text))[0].parameters[0]  # type: ignore[union-attr]
    value, found_unit = read_number(token, units)
    # SCPI-99 takes 9.9E37 and more for infinity.
    assert value == (float(exact) if abs(float(exact)) < 9.9e37 else math.copysign(math.inf, exact))
    assert found_unit == unit


@pytest.mark.parametrize(
    ("text", "units", "value", "unit"),
    [
        ("1MHZ", HERTZ, 1e6, "HZ"),
        ("1 mhz", HERTZ, 1e6, "HZ"),
        ("50 MVPP", AMPLITUDE, 50e-3, "VPP"),
        ("2MOHM", OHM, 2e6, "OHM"),
        ("3 MAOHM", OHM, 3e6, "OHM"),
        ("10 MS", SECOND, 10e-3, "S"),
        ("5EXHZ", HERTZ, 5e18, "HZ"),
        ("5E3HZ", HERTZ, 5e3, "HZ"),
        ("-3 DBM", AMPLITUDE, -3.0, "DBM"),
        ("9.9E37", None, math.inf, ""),
        ("-1e400", None, -math.inf, ""),
    ],
)
def test_suffixes_and_infinity(text: str, units: Units | None, value: float, unit: str) -> None:
    assert read_number(Token("number", text), units) == Quantity(value, unit)


@pytest.mark.parametrize(
    ("token", "units", "code"),
    [
        (Token("number", "1.2.3"), None, -121),
        (Token("number", "+"), None, -121),
        (Token("number", "1_0"), None, -121),
        (Token("number", "1e99999"), None, None),
        (Token("number", "1 e100000"), None, -123),
        (Token("number", "1e" + "9" * 5000), None, -123),
        (Token("number", "1 V"), None, -138),
        (Token("number", "1 OHM"), AMPLITUDE, -131),
        (Token("number", "1 MDBM"), AMPLITUDE, -131),
        (Token("number", "1 M"), AMPLITUDE, -131),
        (Token("character", "FOO"), None, -141),
        (Token("string", "1"), None, -158),
        (Token("block", "", b"1"), None, -168),
    ],
)
def test_what_is_no_number_has_its_own_error(token: Token, units: Units | None, code: int | None) -> None:
    if code is None:
        assert read_number(token, units).value == math.inf
        return
    with pytest.raises(ScpiError) as caught:
        read_number(token, units)
    assert caught.value.code == code


@given(value=st.floats(-1e37, 1e37))
def test_an_answered_number_comes_back_equal(value: float) -> None:
    text = answer_number(value)
    assert float(text) == value
    assert re.fullmatch(r"[+-]\d\.\d{15,16}E[+-]\d{2,3}", text)
    assert read_number(Token("number", text)).value == value


def test_answers_look_as_the_instrument_writes_them() -> None:
    assert answer_number(1e6) == "+1.000000000000000E+06"
    assert answer_number(-0.05) == "-5.000000000000000E-02"
    assert answer_number(math.inf) == "+9.900000000000000E+37"
    assert answer_number(-math.inf) == "-9.900000000000000E+37"
    assert answer_number(math.nan) == "+9.910000000000000E+37"


# Parameters


def test_a_value_out_of_range_becomes_the_limit_and_is_reported() -> None:
    reported: list[ScpiError] = []

    def read(text: str) -> float:
        kind = "character" if text[0].isalpha() else "number"
        return read_within(Token(kind, text), HERTZ, 1.0, 9.0, 4.0, reported.append)  # type: ignore[arg-type]

    assert [read(t) for t in ("5", "MIN", "maximum", "DEF", "1", "9", "9.0000000000001")] == [
        5.0, 1.0, 9.0, 4.0, 1.0, 9.0, 9.0,
    ]  # fmt: skip
    assert reported == []
    assert [read(t) for t in ("0", "10", "1 MHZ", "INF", "NINF")] == [1.0, 9.0, 9.0, 9.0, 1.0]
    assert [error.code for error in reported] == [-222] * 5
    with pytest.raises(ScpiError, match="-141"):
        read("FOO")


@pytest.mark.parametrize(
    ("text", "value"), [("ON", True), ("off", False), ("1", True), ("0", False), ("0.4", False), ("-2", True)]
)
def test_booleans(text: str, value: bool) -> None:
    assert read_boolean(Token("character" if text.isalpha() else "number", text)) is value


def test_words_take_either_form_and_nothing_between() -> None:
    choices = Choices("SINusoid", "SQUare", "DC")
    assert [choices.read(Token("character", word)) for word in ("sin", "SINUSOID", "Square", "dc")] == [
        "SIN", "SIN", "SQU", "DC",
    ]  # fmt: skip
    wrong = {-224: ("character", "SINE"), -128: ("number", "1"), -158: ("string", "SIN"), -168: ("block", "")}
    for code, (kind, text) in wrong.items():
        with pytest.raises(ScpiError) as caught:
            choices.read(Token(kind, text))  # type: ignore[arg-type]
        assert caught.value.code == code


def test_the_number_of_parameters_is_checked() -> None:
    toy = Toy()
    ask(toy, "FREQ 1,2,3,4")
    ask(toy, "DATA:ARB x")
    ask(toy, "*IDN? 1")
    ask(toy, "DATA:ARB x,1")
    assert errors(toy) == [-108, -109, -108, -104]


def test_blocks_reach_their_command_whole() -> None:
    toy = Toy()
    toy.write(b'DATA:ARB x,#15\n;,"\n;ARB y,#0rest;\n', end=True)
    assert toy.log == ["x b'\\n;,\"\\n'", "y b'rest;'"]
    toy.write(b"DATA:ARB x,#19abc\n", end=True)
    assert errors(toy) == [-161]


# Errors and status


def test_the_queue_is_first_in_first_out_and_its_newest_entry_overflows() -> None:
    toy = Toy()
    for code in range(-240, -215):
        ask(toy, f"FAUL {code}")
    assert errors(toy) == [*range(-240, -221), -350]
    assert ask(toy, "SYST:ERR:NEXT?") == [b'+0,"No error"\n']


@pytest.mark.parametrize(
    ("code", "bit"), [(-113, 5), (-199, 5), (-200, 4), (-222, 4), (-350, 3), (785, 3), (-420, 2)]
)
def test_an_error_sets_its_event_bit(code: int, bit: int) -> None:
    toy = Toy()
    assert ask(toy, "*ESR?") == [b"+128\n"]
    ask(toy, f"FAUL {code}")
    assert event_bit(code) == 1 << bit
    assert ask(toy, "*ESR?;*ESR?") == [f"+{1 << bit};+0\n".encode()]


def test_error_text_is_one_line_with_two_quotes_whatever_was_sent() -> None:
    toy = Toy()
    toy.write(b'*ESE "a""b\xff' + b"x" * 5000 + b'"\n')
    (line,) = ask(toy, "SYST:ERR?")
    assert re.fullmatch(rb'-158,"String data not allowed; a\'b\?x{76}"\n', line)
    toy.write(b"VOLT:" + b"X" * 5000 + b"\n")
    (line,) = ask(toy, "SYST:ERR?")
    assert line.startswith(b'-112,"Program mnemonic too long; XXXX')
    assert len(line) < 160


def test_a_command_error_drops_the_rest_and_an_execution_error_does_not() -> None:
    toy = Toy()
    assert ask(toy, "*OPC?;FAUL -222;*OPC?;FOO;*OPC?") == [b"1;1\n"]
    assert errors(toy) == [-222, -113]


def test_reset_keeps_the_queue_and_clear_status_empties_it() -> None:
    toy = Toy()
    ask(toy, "FOO;*RST")
    ask(toy, "*RST")
    assert ask(toy, "*STB?") == [b"+4\n"]
    ask(toy, "*ESE 32;*SRE 4;*CLS")
    assert ask(toy, "*STB?;*ESR?;*ESE?;*SRE?") == [b"+0;+0;+32;+4\n"]
    assert errors(toy) == []


def test_the_status_byte_sums_up() -> None:
    toy = Toy()
    ask(toy, "*CLS;*ESE 32;*SRE 32")
    assert toy.read_stb() == 0
    toy.write(b"*OPC?\n")
    assert toy.read_stb() == 16
    answers(toy)
    ask(toy, "FOO")
    assert toy.read_stb() == 4 + 32 + 64
    toy.status.questionable.set(4096, True)
    ask(toy, "STAT:QUES:ENAB 4096")
    assert toy.read_stb() == 4 + 8 + 32 + 64
    assert ask(toy, "STAT:QUES:COND?;EVEN?") == [b"+4096;+4096\n"]
    assert ask(toy, "STAT:QUES?;:STAT:OPER?") == [b"+0;+0\n"]
    assert errors(toy) == [-113]
    ask(toy, "*OPC")
    assert ask(toy, "*ESR?") == [b"+33\n"]


def test_masks_are_refused_out_of_range() -> None:
    toy = Toy()
    ask(toy, "*ESE 256")
    ask(toy, "*ESE 255.4")
    assert ask(toy, "*ESE?") == [b"+255\n"]
    assert errors(toy) == [-222]


def test_device_clear_drops_input_and_output_but_not_the_queue() -> None:
    toy = Toy()
    toy.write(b"FOO\n*IDN?\nDATA:ARB x,#19ab")
    toy.clear()
    assert toy.read() is None
    assert ask(toy, "*OPC?") == [b"1\n"]
    assert errors(toy) == [-113]


def test_answers_that_nobody_reads_do_not_pile_up_for_ever() -> None:
    toy = Toy()
    toy.write(b"*OPC?\n" * 2000)
    assert len(answers(toy)) == 1024
    assert errors(toy)[0] == -430


def test_a_trigger_that_nothing_waits_for_is_reported() -> None:
    toy = Toy()
    ask(toy, "*TRG;*WAI")
    assert errors(toy) == [-211]


@given(data=st.data())
def test_any_split_of_the_bytes_gives_the_same_answers(data: st.DataObject) -> None:
    # given a session of commands, queries, blocks and errors
    lines = [
        b"*IDN?", b"FREQ 1 MHZ;FREQ?", b'DATA:ARB "x",#16a\n;\n"b', b"VOLT:UNIT VPP;OFFS?;:FOO", b"SYST:ERR?",
        b"*ESR?;*OPC?", b"DATA:ARB y,#3\n", b"#", b"\r",
    ]  # fmt: skip
    stream = b"\n".join(data.draw(st.lists(st.sampled_from(lines), max_size=6))) + b"\n"
    cuts = data.draw(st.lists(st.integers(0, len(stream)), max_size=8).map(sorted))
    # when one device gets it whole and another in pieces
    whole, pieces = Toy(), Toy()
    whole.write(stream)
    for start, stop in itertools.pairwise([0, *cuts, len(stream)]):
        pieces.write(stream[start:stop])
    # then both say and do the same
    assert answers(pieces) == answers(whole)
    assert pieces.log == whole.log
    assert errors(pieces) == errors(whole)
