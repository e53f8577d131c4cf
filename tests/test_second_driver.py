"""A second driver at the instruments of a running measurement: refused, or told and repaired."""

from __future__ import annotations

import re
from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import scope_bench
from served import port_of, served

from belahil.bench import Endpoints, open_bench
from belahil.config import parse_bench
from belahil.errors import InstrumentRefused, Interfered, LinkClosed
from belahil.stimuli import Sine
from belahil.values import WindowRequest
from drivers import build, visa_link
from drivers.visa_link import VisaLink
from sim.build import endpoints
from sim.transports.one_receiver import TAKEN
from tests.served import RawClient

if TYPE_CHECKING:
    from pathlib import Path

    from belahil.bench import Bench
    from belahil.config import BenchConfig

TONE = Sine(2.5e6, 0.05)
SAMPLES = 2000


def _client(address: str, link: str) -> BenchConfig:
    return parse_bench(
        f'[generator]\naddress = "{address}"\nvisa_library = "@py"\n[digitizer]\nlink = "{link}"\n'
    )


def _rms(bench: Bench, shot: int) -> tuple[float, int]:
    taken = bench.measure(TONE, WindowRequest(shot, 4, SAMPLES))
    assert taken.window.counts is not None
    return float(np.std(taken.window.counts)), taken.attempt


@pytest.mark.parametrize("place", ["address", "hislip_address"])
def test_a_driver_that_the_receiver_refuses_has_not_touched_the_generator(place: str) -> None:
    # given a bench that measures a tone, at a served generator and receiver
    with served() as (places, _):
        config = _client(getattr(places, place), places.link)
        with open_bench(config) as first:
            loud, _ = _rms(first, 0)
            # when another driver comes with the same file, and is refused
            with pytest.raises(InstrumentRefused, match=TAKEN):
                open_bench(config)
            # then the next window is as it was, at the first attempt
            again, attempt = _rms(first, 1)
            assert attempt == 1
            assert again == pytest.approx(loud, rel=0.02)
            assert loud > 50


def test_whoever_sets_the_generator_beside_us_is_told_and_the_shot_repeated() -> None:
    with served() as (places, _):
        config = _client(places.address, places.link)
        with open_bench(config) as first:
            loud, _ = _rms(first, 0)
            # when another driver takes the generator alone, resets it and sets what it likes
            other = build.open_generator(config, Endpoints())
            other.prepare(Sine(1e6, 0.01), "immediate")
            other.output(True)
            # then our next window is right, at the second attempt, and the reason is told
            again, attempt = _rms(first, 1)
            assert attempt == 2
            assert again == pytest.approx(loud, rel=0.02)
            assert "another program speaks to the instrument" in first.repeated_because
            # and the other one learns of us, too
            with pytest.raises(Interfered):
                other.prepare(Sine(1e6, 0.02), "immediate")
            other.close()
            # and when it leaves, which switches the output off, that is repaired and told as well
            again, attempt = _rms(first, 2)
            assert attempt == 2
            assert again == pytest.approx(loud, rel=0.02)


def test_a_program_that_sends_commands_alone_is_told_at_the_next_change_and_at_the_end() -> None:
    with served() as (places, _), RawClient(port_of(places.address)) as stranger:
        config = _client(places.address, places.link)
        bench = open_bench(config)
        _rms(bench, 0)
        # when somebody else adds an offset, and we play something else
        stranger.ask(b":SOUR1:VOLT:OFFS 0.01;*OPC?\n")
        shot = bench.measure(Sine(3e6, 0.05), WindowRequest(1, 4, SAMPLES))
        # then that is told
        assert shot.attempt == 2
        assert re.search(r"VOLT:OFFS\? answers .*1\.0+E-02, and 0", bench.repeated_because)
        # and what is done to the last stimulus is told when the bench is closed
        stranger.ask(b":SOUR1:VOLT:OFFS 0.01;*OPC?\n")
        with pytest.raises(Interfered, match="since the last change of the stimulus may be wrong"), bench:
            pass
        assert stranger.ask(b"OUTP?\n") == b"0\n"


def test_the_log_of_a_run_says_who_came_between(tmp_path: Path) -> None:
    from belahil.run import Run
    from procedures import characterize
    from procedures.characterize import GainOptions

    with served() as (places, _), RawClient(port_of(places.address)) as stranger:
        with open_bench(_client(places.address, places.link)) as bench:
            plan = characterize.plan(bench, GainOptions((4,), (20e-3,), (1e6, 5e6), dark_windows=1))
            with Run.create(
                tmp_path / "run", "characterize", bench.config, {}, None, plan=plan.as_json()
            ) as run:
                # given somebody who switches the output off between two shots
                def between(done: int, of: int) -> None:
                    if done < of:
                        stranger.ask(b"OUTP OFF;*OPC?\n")

                characterize.measure(bench, run, plan, between)
        log = (tmp_path / "run" / "log.txt").read_text()
    assert re.search(r"came at attempt 2: .*OUTP1\? answers 0, and (1|on) was set: another program", log)


def test_hislip_is_locked_so_that_a_second_driver_gets_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(visa_link, "LOCK_TIMEOUT_S", 0.05)
    with served() as (places, _):
        with closing(VisaLink(places.hislip_address, "@py")) as first:
            with pytest.raises(LinkClosed, match=r"^TCPIP.*hislip0.*: another program has locked") as caught:
                VisaLink(places.hislip_address, "@py")
            assert "\n" not in str(caught.value)
            first.write(b"*IDN?\n")
            assert first.read(4096, 2.0).startswith(b"Agilent")
        # and it is free again when the first has left
        with closing(VisaLink(places.hislip_address, "@py")) as second:
            second.write(b"*IDN?\n")
            assert second.read(4096, 2.0).startswith(b"Agilent")


def test_an_oscilloscope_that_somebody_asks_meanwhile_is_set_again() -> None:
    # given a bench with an oscilloscope in this process, whose marks somebody else moves
    config = scope_bench.config("rigol-ds1000z")
    ends = endpoints(config)
    with build.bench(config, ends) as bench:
        stimulus, request = scope_bench.SCRIPT[0]
        bench.measure(stimulus, request)
        for device in ends.visa_library._devices.values():
            device.write(b"*ESE 77\n")
        shot = bench.measure(stimulus, replace(request, shot=request.shot + 1))
    assert shot.attempt > 1
    assert "another program" in bench.repeated_because
