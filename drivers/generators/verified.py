"""A generator of any family in a known state: set, read back, compared, recovered; the dialect has its words.

The first channel is used.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import (
    CorruptData,
    InstrumentError,
    InstrumentRefused,
    Interfered,
    LimitExceeded,
    LinkClosed,
    LinkError,
    StaleData,
)
from belahil.generators import GeneratorSetting, model_of, setting_for, stimulus_of
from belahil.stimuli import SampledPulse, Sine
from drivers.scpi import NO_ERROR, TRIGGER_IGNORED, read_error

if TYPE_CHECKING:
    from collections.abc import Container

    from belahil.generators import ArbBlock, GeneratorModel
    from belahil.stimuli import Stimulus
    from drivers.generators.dialect import Dialect, Expected, Item
    from drivers.scpi import ScpiSession


class VerifiedGenerator:
    """A generator in a known state: what was set is read back and compared before it is relied on.

    Parameters
    ----------
    session : ScpiSession
        With the instrument; `close` closes it.
    dialect : Dialect
        How its family is spoken to.
    load_ohm : float
        Load setting, ohm; ``inf`` for high impedance.
    largest_v : float
        Largest voltage into `load_ohm` that the instrument itself shall allow, V.

    Raises
    ------
    InstrumentError
        The model is unknown, or the instrument failed or refused.

    Notes
    -----
    The instrument is reset when it is opened, and again after any error: its output is off then. Only what
    has changed is sent. All settings are read back together with the error queue. Everything is sent once
    more when what was sent is not there: all commands may be repeated. What is otherwise though it was not
    sent is somebody else's doing, and `Interfered`; the next `prepare` sends everything.
    """

    def __init__(self, session: ScpiSession, dialect: Dialect, load_ohm: float, largest_v: float) -> None:
        self._session = session
        self._dialect = dialect
        self._load_ohm = load_ohm
        try:
            self._model = model_of(session.identity)
        except LimitExceeded as error:
            raise InstrumentError(str(error)) from error
        self._base = dialect.base_items(self._model, load_ohm, largest_v)
        self._verified: GeneratorSetting | None = None
        self._closed_off: bool | None = None
        self._apply(self._silent)

    @property
    def identity(self) -> str:
        """Answer of the instrument to ``*IDN?``."""
        return self._session.identity

    @property
    def limits(self) -> GeneratorModel:
        """Limits and grids of the model in `identity`."""
        return self._model

    def prepare(self, stimulus: Stimulus, trigger: str) -> Stimulus:
        """Load a stimulus and return what will really be played; the output may be off afterwards.

        Parameters
        ----------
        stimulus : Stimulus
            In volts into the load setting.
        trigger : {"immediate", "generator", "digitizer"}
            Who will start it.

        Raises
        ------
        LimitExceeded
            The model cannot make it; nothing was sent.
        InstrumentRefused
            With the first entry of the error queue; the output is off.
        Interfered
            Another program has set the instrument since.
        LinkError
            No proof that it is set.
        """
        self._check_open()
        wanted = setting_for(stimulus, self._model, self._load_ohm, trigger)
        self._apply(replace(wanted, output=self._stays_on(wanted)))
        return stimulus_of(wanted) if isinstance(stimulus, Sine | SampledPulse) else stimulus

    def output(self, on: bool) -> None:
        """Connect or disconnect the output.

        Raises
        ------
        InstrumentError
            As for `prepare`.
        """
        self._check_open()
        now = self._verified or self._silent
        if self._verified is None or now.output != on:
            self._apply(replace(now, output=on))

    def trigger(self) -> None:
        """Start a stimulus that was prepared with ``trigger="generator"``.

        Raises
        ------
        InstrumentRefused
            None waits for it; nothing was sent.
        LinkError
            No proof that it was sent.
        """
        self._check_open()
        now = self._verified
        if now is None or not (now.burst and now.trigger_source == "BUS"):
            raise InstrumentRefused(
                f"{self._model.name}: trigger ignored: no stimulus waits for one", TRIGGER_IGNORED
            )
        try:
            self._session.send(self._dialect.trigger)
        except LinkError:
            self._verified = None
            raise

    def confirm(self, whole: bool = False) -> None:
        """Prove that nobody has set the instrument since the last `prepare` or `output`.

        Parameters
        ----------
        whole : bool
            Read back all settings, and not only the marks of our questions and the output's switch.

        Raises
        ------
        Interfered
            Somebody has; the next `prepare` sends everything.
        InstrumentRefused
            An error waits in the queue.
        LinkError
            No proof.
        """
        self._check_open()
        now, self._verified = self._verified, None
        if now is None:
            raise StaleData(f"{self._model.name}: nothing is proved to be set")
        if whole:
            self._verify([*self._base, *self._dialect.items(now, self._model)], sent=())
        else:
            off = self._dialect.off
            (answer,) = self._session.ask(off.query)
            if self._dialect.agrees(answer, off.expected) == now.output:
                raise self._interfered(off.query, answer, "on" if now.output else "off")
        self._verified = now

    def close(self) -> bool:
        """Switch the output off and let go of the link; never raises for a dead link.

        Returns
        -------
        bool
            Whether the instrument confirmed that its output is off; the same when it is closed again.
        """
        if self._closed_off is None:
            self._closed_off = self._switch_off()
            self._session.close()
        return self._closed_off

    def _check_open(self) -> None:
        if self._closed_off is not None:
            raise LinkClosed(f"{self._model.name}: the driver was closed")

    @property
    def _silent(self) -> GeneratorSetting:
        return GeneratorSetting(function="DC", load_ohm=self._load_ohm)

    def _stays_on(self, wanted: GeneratorSetting) -> bool:
        """Whether the output may stay on meanwhile: not while the shape or the waveform changes."""
        now = self._verified
        return now is not None and now.output and (now.function, now.arb) == (wanted.function, wanted.arb)

    def _apply(self, wanted: GeneratorSetting) -> None:
        before, self._verified = self._verified, None
        if wanted.output and not (before and before.output):
            self._session.pause(self._model.rest_before_on_s)
        try:
            self._set(before, wanted)
        except (LinkClosed, Interfered):
            raise
        except (LinkError, InstrumentRefused):
            self._session.recover()
            self._set_again(wanted)
        self._verified = wanted

    def _set_again(self, wanted: GeneratorSetting) -> None:
        try:
            self._set(None, wanted)
        except LinkClosed:
            raise
        except InstrumentError as error:
            # An instrument that does not know a query leaves it unanswered, and says so in its queue.
            if isinstance(error, LinkError) and self._model.error_queue_depth:
                self._refuse(self._session.errors())
            self._switch_off()
            raise

    def _set(self, before: GeneratorSetting | None, wanted: GeneratorSetting) -> None:
        """Send what differs from `before`, and read all of it back."""
        items = self._dialect.items(wanted, self._model, before)
        if before is None:
            self._session.send(*self._dialect.reset(), *(item.command for item in self._base))
        if wanted.arb is not None and not (before and same_codes(before.arb, wanted.arb)):
            self._dialect.upload(self._session, wanted.arb)
        changed = self._changed(items, before, wanted)
        if changed:
            self._session.send(*(item.command for item in changed if item.command))
        sent = changed if before else [*self._base, *items]
        self._verify([*self._base, *items], {item.query for item in sent})

    def _changed(
        self, items: list[Item], before: GeneratorSetting | None, wanted: GeneratorSetting
    ) -> list[Item]:
        """Return those of `items` that must be sent; all of them with another shape or other points."""
        if before is None or before.function != wanted.function or not same_codes(before.arb, wanted.arb):
            return items
        known = {item.query: item.expected for item in self._dialect.items(before, self._model)}
        return [item for item in items if known.get(item.query) != item.expected]

    def _verify(self, items: list[Item], sent: Container[str]) -> None:
        """Read items back; `sent` holds the questions of those that were sent."""
        queries = [item.query for item in items]
        if self._model.error_queue_depth:
            *answers, error = self._session.ask(*queries, ":SYST:ERR?")
            number, text = read_error(error)
            if number != NO_ERROR:
                self._refuse([(number, text), *self._session.errors()])
        else:
            answers = self._session.ask(*queries)
        for item, answer in zip(items, answers, strict=True):
            if self._dialect.agrees(answer, item.expected):
                continue
            if item.query not in sent:
                raise self._interfered(item.query, answer, item.expected)
            raise CorruptData(
                f"{self._model.name}: {item.command or item.query} was to give {item.expected}, "
                f"and {item.query} answers {answer}"
            )

    def _interfered(self, query: str, answer: str, expected: Expected) -> Interfered:
        return Interfered(
            f"{self._model.name}: {query} answers {answer}, and {expected} was set: another program, or a "
            "hand at its panel, has changed it"
        )

    def _refuse(self, errors: list[tuple[int, str]]) -> None:
        if errors:
            said = "; ".join(f'{number:+d} "{text}"' for number, text in errors)
            raise InstrumentRefused(f"{self._model.name} refused: {said}", errors[0][0])

    def _switch_off(self) -> bool:
        self._verified = None
        off = self._dialect.off
        for _ in range(2):
            with suppress(InstrumentError):
                self._session.send(off.command)
                if self._dialect.agrees(self._session.ask(off.query)[0], off.expected):
                    return True
        return False


def same_codes(first: ArbBlock | None, second: ArbBlock | None) -> bool:
    """Tell whether two settings use the same points, or both none."""
    if first is None or second is None:
        return first is second
    return np.array_equal(first.codes, second.codes)
