"""Answers of a SCPI instrument beside recorded ones, question by question."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from belahil.parity import Difference
from belahil.parity_talk import Answering, Exchange, Talk
from belahil.scpi_text import Block, error_entry, fields, header_of, read_field, text_difference, units

if TYPE_CHECKING:
    from collections.abc import Sequence

    from belahil.parity import DifferenceKind
    from belahil.parity_tally import Tally

_MARK = "*ESE"
_ERRORS = re.compile(r"SYST(EM)?:ERR(OR)?(:NEXT)?\?")
_AFTER_AT_MOST = 40
_SHOWN_CHARACTERS = 200
MEASURED_FIELDS = {"WAV:PRE?": (5,), "WAV:XOR?": (0,), "WFMO:XZE?": (0,)}
"""Of an oscilloscope: which numbers of an answer tell where between two samples the trigger came."""
SAMPLES = {
    "keysight-infiniivision": "<u2",
    "rigol-ds1000z": "u1",
    "siglent-sds": "i1",
    "tektronix-mso": ">i2",
}
"""Samples in a block, as our drivers ask the oscilloscopes of each family for them."""


class ScpiTalk(Talk):
    """The link of a SCPI instrument.

    A question that is put again and again with nothing between is a wait: the last recorded answer has to be
    among those of the emulated instrument, which need not take as long.

    Parameters
    ----------
    link, instrument, tally, real_clock
        See `Talk`.
    samples : str
        Type of the samples in a block whose bytes hold noise, as NumPy writes it; empty: bytes have to be
        equal.
    """

    def __init__(
        self, link: str, instrument: Answering, tally: Tally, real_clock: bool, samples: str = ""
    ) -> None:
        super().__init__(link, instrument, tally, real_clock)
        self._samples = samples
        self._after: list[str] = []
        self._raised: list[str] = []
        self._held: list[Exchange] = []

    def raised_by(self, data: bytes) -> tuple[str, ...]:
        """Return which messages raised the emulated errors that waited before `data` was written."""
        waiting = tuple(self._raised)
        left = self.instrument.error_count
        written = "; ".join(unit for unit in units(data) if not _is_mark(unit))
        # What a message took of the queue are the oldest, what it raised are the newest.
        headers = [header_of(unit) for unit in units(data)]
        taken = sum(1 for header in headers if _ERRORS.fullmatch(header))
        kept = [] if "*CLS" in headers else self._raised[taken:][:left]
        self._raised = kept + [written] * (left - len(kept))
        return waiting

    def flush(self) -> None:
        """Compare the wait that may have ended."""
        held, self._held = self._held, []
        if held:
            self._count(held)

    def drop(self) -> None:
        """Forget what the end of the recording cut short; a wait before it was whole."""
        super().drop()
        self.flush()

    def compare(self, exchange: Exchange) -> None:
        """Count the answers; those of a wait when it is over."""
        asked = [unit for unit in units(exchange.sent) if not _is_mark(unit)]
        pure = all(header_of(unit).endswith("?") for unit in asked)
        errors = any(_ERRORS.fullmatch(header_of(unit)) for unit in asked)
        if self._held and (not pure or errors or _questions(self._held[0]) != asked):
            self.flush()
        if not exchange.asked:
            self._after += asked
        elif pure and asked and not errors:
            self._held.append(exchange)
            if exchange.ends_wait:
                self.flush()
        else:
            self._count([exchange])

    def _count(self, waits: Sequence[Exchange]) -> None:
        last = waits[-1]
        asked = units(last.sent)
        headers = [header_of(unit) for unit in asked]
        questions = [header for header in headers if header.endswith("?")]
        for one in waits:
            is_block = isinstance(read_field(one.recorded), Block)
            if one.recorded:
                self.tally.took(
                    self.link, "block" if is_block else "question", one.recorded_s, one.emulated_s
                )
        recorded = fields(last.recorded, len(questions)) if last.recorded else None
        emulated = [fields(one.emulated, len(questions)) for one in waits if one.emulated]
        whole = [one for one in emulated if one is not None]
        if recorded is None or not whole or not questions:
            return self._count_whole(last, questions)
        entry = 0
        for place, unit in enumerate(asked):
            if not headers[place].endswith("?"):
                if not _is_mark(unit):
                    self._after.append(unit)
                continue
            index = sum(header.endswith("?") for header in headers[:place])
            said = [one[index] for one in whole]
            question = headers[place]
            if _ERRORS.fullmatch(question):
                raised = last.raised_by[entry] if entry < len(last.raised_by) else ""
                self._count_error(last.record, question, recorded[index], said[-1], raised)
                entry += 1
                continue
            answer = recorded[index] if recorded[index] in said and question != f"{_MARK}?" else said[-1]
            self._count_answer(last.record, question, recorded[index], answer)
            if not _is_mark(unit):
                self._after.append(unit)

    def _count_whole(self, exchange: Exchange, questions: Sequence[str]) -> None:
        """Count answers that cannot be cut into one for each question."""
        more = f" and {len(questions) - 1} more" if len(questions) > 1 else ""
        name = questions[0] + more if questions else "(nothing asked)"
        self._after += [unit for unit in units(exchange.sent) if not _is_mark(unit)]
        if exchange.recorded == exchange.emulated:
            said = _short(exchange.recorded) if exchange.recorded else "(no answer)"
            return self.tally.equal(self.link, name, said)
        silent = not exchange.recorded or not exchange.emulated
        both = [_short(said) if said else "(no answer)" for said in (exchange.recorded, exchange.emulated)]
        self._differs(exchange.record, name, "silence" if silent else "text", *both)

    def _count_error(
        self, record: int, question: str, recorded: bytes, emulated: bytes, raised_by: str
    ) -> None:
        ours, theirs = recorded.decode("latin-1"), emulated.decode("latin-1")
        ours_entry, theirs_entry = error_entry(ours), error_entry(theirs)
        if ours_entry is None or theirs_entry is None:
            self._count_answer(record, question, recorded, emulated)
        elif ours_entry[0] != theirs_entry[0] or ours_entry[1] != theirs_entry[1]:
            kind: DifferenceKind = "error" if ours_entry[0] != theirs_entry[0] else "wording"
            after = tuple(self._after[-_AFTER_AT_MOST:])
            found = Difference(record, kind, ours, theirs, after, raised_by if theirs_entry[0] else "")
            self.tally.differs(self.link, question, found)
        else:
            self._count_answer(record, question, recorded, emulated)
        if ours_entry and theirs_entry and ours_entry[0] == theirs_entry[0] != 0:
            self.tally.error(self.link, ours_entry[0])
        if ours_entry is None or ours_entry[0] == 0:
            self._after.clear()

    def _count_answer(self, record: int, question: str, recorded: bytes, emulated: bytes) -> None:
        ours, theirs = read_field(recorded), read_field(emulated)
        if isinstance(ours, Block) and isinstance(theirs, Block):
            return self._count_block(record, question, ours, theirs)
        told = _cut(str(ours)), _cut(str(theirs))
        if isinstance(ours, Block) or isinstance(theirs, Block):
            return self._differs(record, question, "shape", *told)
        kind: DifferenceKind | None = text_difference(ours, theirs)
        if kind in ("number", "format") and self._samples and _but_measured(question, ours, theirs):
            kind = "measured"
        if kind is None:
            self.tally.equal(self.link, question, told[0])
        else:
            self._differs(record, question, kind, *told)

    def _count_block(self, record: int, question: str, ours: Block, theirs: Block) -> None:
        told = _cut(str(ours)), _cut(str(theirs))
        if told[0] != told[1]:
            self._differs(record, question, "shape", *told)
        elif self._samples and len(ours.data) % np.dtype(self._samples).itemsize == 0:
            samples = [np.frombuffer(one.data, self._samples) for one in (ours, theirs)]
            self.tally.window(self.link, record, question, told[0], samples[0], samples[1])
        elif ours.data != theirs.data:
            place = next(
                n for n, pair in enumerate(zip(ours.data, theirs.data, strict=True)) if len({*pair}) > 1
            )
            both = [f"{_cut(str(one))}, byte {place} {one.data[place]:02x}" for one in (ours, theirs)]
            self._differs(record, question, "points", *both)
        else:
            self.tally.equal(self.link, question, told[0])

    def _differs(
        self, record: int, question: str, kind: DifferenceKind, recorded: str, emulated: str
    ) -> None:
        self.tally.differs(self.link, question, Difference(record, kind, recorded, emulated))


def _is_mark(unit: str) -> bool:
    """Tell whether a unit is one of those with which our drivers number their questions."""
    return header_of(unit).removesuffix("?") == _MARK


def _questions(exchange: Exchange) -> list[str]:
    return [unit for unit in units(exchange.sent) if not _is_mark(unit)]


def _but_measured(question: str, recorded: str, emulated: str) -> bool:
    """Tell whether two answers are equal but for numbers that the instrument measures."""
    measured = MEASURED_FIELDS.get(question, ())
    pairs = list(zip(recorded.split(","), emulated.split(","), strict=False))
    return bool(measured) and all(
        text_difference(*pair) is None for place, pair in enumerate(pairs) if place not in measured
    )


def _short(said: bytes) -> str:
    return _cut(str(read_field(said.removesuffix(b"\n"))))


def _cut(text: str) -> str:
    return text if len(text) <= _SHOWN_CHARACTERS else f"{text[:_SHOWN_CHARACTERS]}..."
