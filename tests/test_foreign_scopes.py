"""A class that others wrote for the real oscilloscope takes and reads a record of the emulated one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from scope_bench import config, device_of

from belahil.generators import GeneratorSetting
from sim.build import SCOPE_ADDRESS, endpoints

keysight = pytest.importorskip("pymeasure.instruments.keysight")
SILENT = "noise_rms_v_by_code = [0.0]"
GAIN = 5.19  # of the preset, below its cut-off


@pytest.fixture
def ends() -> Any:
    return endpoints(config("keysight-infiniivision", receiver=SILENT))


@pytest.fixture
def client(ends: Any) -> Iterator[Any]:
    with pytest.warns(FutureWarning, match="SCPI"):  # its authors do not know that it speaks SCPI
        instrument = keysight.KeysightDSOX1102G(SCOPE_ADDRESS, visa_library=ends.visa_library)
    yield instrument
    assert instrument.check_errors() == []
    instrument.adapter.close()


def test_pymeasure_reads_the_volts_and_seconds_that_the_generator_plays(ends: Any, client: Any) -> None:
    # given a sine
    frequency_hz, volts_pp = 100e3, 0.1
    device_of(ends)._port.play(  # type: ignore[attr-defined]
        GeneratorSetting(function="SIN", frequency_hz=frequency_hz, amplitude_vpp=volts_pp, output=True)
    )
    # when the class sets, takes and reads a record
    client.default_setup()
    client.ch1.setup(bwlimit=False, coupling="dc", display=True, offset=0.0, scale=0.1)
    client.timebase_setup(mode="main", offset=0.0, scale=1e-5)
    client.waveform_points = 1000
    client.digitize("channel1")
    volts, preamble = client.download_data("channel1", points=1000)
    # then its fit is the receiver's gain times what was played, to a code
    times_s = preamble["xorigin"] + preamble["xincrement"] * np.arange(volts.size)
    turns = 2 * np.pi * frequency_hz * times_s
    shapes = np.stack([np.sin(turns), np.cos(turns), np.ones(turns.size)], axis=1)
    fitted = np.linalg.lstsq(shapes, volts, rcond=None)[0]
    assert volts.size == preamble["points"] == 1000
    assert 2 * np.hypot(*fitted[:2]) == pytest.approx(volts_pp * GAIN, abs=preamble["yincrement"])
    assert np.abs(volts - shapes @ fitted).max() < preamble["yincrement"]
    assert times_s[[0, -1]] == pytest.approx([-50e-6, 49.9e-6], abs=0.1e-6)


def test_pymeasure_reads_what_it_sets(client: Any) -> None:
    channel = client.ch1
    for place, name, value in (
        (channel, "bwlimit", True),
        (channel, "coupling", "ac"),
        (channel, "display", False),
        (channel, "invert", True),
        (channel, "offset", 0.5),
        (channel, "probe_attenuation", 10),
        (channel, "range", 4.0),
        (channel, "scale", 0.25),
        (client, "timebase_mode", "window"),
        (client, "timebase_offset", 1e-3),
        (client, "timebase_range", 1e-3),
        (client, "timebase_scale", 1e-5),
        (client, "acquisition_type", "average"),
        (client, "acquisition_mode", "segmented"),
        (client, "waveform_points_mode", "raw"),
        (client, "waveform_points", 500),
        (client, "waveform_source", "channel2"),
        (client, "waveform_format", "word"),
    ):
        setattr(place, name, value)
        read = getattr(place, name)
        assert read == (value if isinstance(value, str) else pytest.approx(value)), name
    assert channel.current_configuration["RANG"] == 2.0
    assert channel.current_configuration["INV"]
    assert client.timebase["MAIN:RANG"] == 1e-4
