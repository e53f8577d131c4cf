"""What the words of an SDG2000X change, and how they are answered: names with values, units glued to them."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from belahil.generators import round_to_step
from sim.devices.scpi.parser import Token
from sim.devices.scpi.status import ScpiError

if TYPE_CHECKING:
    from sim.devices.generators.siglent_sdg_channel import SdgChannel

Pairs = list[tuple[str, str]]
_SHAPES = ("SINE", "SQUARE", "RAMP", "PULSE", "NOISE", "ARB", "DC")
_SYNC_TYPES = ("CH1", "CH2", "MOD_CH1", "MOD_CH2")
_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)\s*([a-zA-Z/]*)")
_MULTIPLIERS = {"K": 1e3, "M": 1e6, "G": 1e9, "U": 1e-6, "N": 1e-9}
_MOST_DELAY_S = 100.0
# Volts rms per volt peak to peak, as this instrument shows them.
_RMS = {"SINE": 0.3535, "SQUARE": 0.5, "PULSE": 0.5, "RAMP": 1 / 3.464}


def pairs_of(tokens: tuple[Token, ...]) -> Pairs:
    """Read names, in capitals, and values; ON or OFF alone is STATE, and the last may lack a value."""
    words = [token.text for token in tokens]
    if words[0].upper() in ("ON", "OFF"):
        words.insert(0, "STATE")
    words += [""] * (len(words) % 2)
    return [(key.upper(), value) for key, value in zip(words[::2], words[1::2], strict=True)]


def number_of(text: str) -> float | None:
    """Read a number with any unit; None for what is none, which changes nothing."""
    found = _NUMBER.fullmatch(text.strip())
    if found is None:
        return None
    unit = found[2].upper()
    # Before HZ, SA/S and nothing else a letter makes it larger; before S and V it makes it smaller.
    factor = 1.0
    for tail in ("HZ", "SA/S", "S", "VPP", "V"):
        if unit.endswith(tail) and unit != tail:
            small = tail in ("S", "V", "VPP")
            letter = unit.removesuffix(tail)
            factor = 1e-3 if small and letter == "M" else _MULTIPLIERS.get(letter, 1.0)
            break
    value = float(found[1]) * factor
    return value if math.isfinite(value) else None


def _g(value: float, digits: int = 6) -> str:
    return f"{value + 0.0:.{digits}g}"


def change_output(channel: SdgChannel, pairs: Pairs) -> None:
    """Do ``OUTP``: a load outside of its span becomes the end of it."""
    for key, value in pairs:
        number = number_of(value)
        if key == "STATE":
            channel.output = value.upper() == "ON"
        elif key == "PLRT" and value.upper() in ("NOR", "INVT"):
            channel.polarity = "INV" if value.upper() == "INVT" else "NORM"
        elif key == "LOAD" and value.upper() == "HZ":
            channel.set_load(math.inf)
        elif key == "LOAD" and number is not None:
            least, most = channel.model.load_span_ohm
            channel.set_load(float(int(min(max(number, least), most))))


def shown_output(channel: SdgChannel) -> str:
    """Answer ``OUTP?``."""
    load = "HZ" if math.isinf(channel.load_ohm) else f"{channel.load_ohm:.0f}"
    polarity = "INVT" if channel.polarity == "INV" else "NOR"
    return f"{'ON' if channel.output else 'OFF'},LOAD,{load},PLRT,{polarity}"


def change_polarity(channel: SdgChannel, pairs: Pairs) -> None:
    """Do ``INVT``, which is polarity too."""
    for key, value in pairs:
        if key == "STATE":
            channel.polarity = "INV" if value.upper() == "ON" else "NORM"


def shown_polarity(channel: SdgChannel) -> str:
    """Answer ``INVT?``."""
    return "ON" if channel.polarity == "INV" else "OFF"


def change_sync(channel: SdgChannel, pairs: Pairs) -> None:
    """Do ``SYNC``."""
    for key, value in pairs:
        if key == "STATE":
            channel.sync = value.upper() == "ON"
        elif key == "TYPE" and value.upper() in _SYNC_TYPES:
            channel.sync_type = value.upper()


def shown_sync(channel: SdgChannel) -> str:
    """Answer ``SYNC?``; what does not matter now is left out (assumed)."""
    return f"ON,TYPE,{channel.sync_type}" if channel.sync else "OFF"


def keep_off(_: SdgChannel, pairs: Pairs) -> None:
    """Do ``MDWV`` and ``SWWV``: they can be off alone.

    Raises
    ------
    ScpiError
        -221 for what is to be on.
    """
    if ("STATE", "ON") in [(key, value.upper()) for key, value in pairs]:
        raise ScpiError(-221, "modulations and sweeps are not emulated")


def shown_off(_: SdgChannel) -> str:
    """Answer ``MDWV?`` and ``SWWV?``."""
    return "STATE,OFF"


def change_wave(channel: SdgChannel, pairs: Pairs) -> None:
    """Do ``BSWV``, from left to right; what does not belong to the present shape changes nothing."""
    for key, value in pairs:
        number = number_of(value)
        if key == "WVTP" and value.upper() in _SHAPES:
            channel.set_function(value.upper())
        elif number is not None:
            _change_number(channel, key, number)


def _change_number(channel: SdgChannel, key: str, number: float) -> None:
    if key == "OFST":
        channel.set_offset(number)
    elif channel.function == "DC":
        return
    elif key == "FRQ":
        channel.set_frequency(number)
    elif key == "PERI" and number > 0:
        channel.set_frequency(1 / number)
    elif key == "AMP":
        channel.set_amplitude(number, "VPP")
    elif key == "AMPVRMS" and channel.function in _RMS:
        channel.set_amplitude(number / _RMS[channel.function], "VPP")
    elif key in ("HLEV", "LLEV"):
        channel.set_level(number, key == "HLEV")
    elif key == "PHSE":
        channel.phase_deg = math.fmod(number, 360.0)


def shown_wave(channel: SdgChannel) -> str:
    """Answer ``BSWV?``; ten digits of the frequency, six of all else."""
    shape = channel.function
    if shape == "DC":
        return f"WVTP,DC,OFST,{_g(channel.offset_v)}V"
    low, high = channel.levels()
    fields = [
        ("WVTP", shape),
        ("FRQ", _g(channel.frequency_hz, 10) + "HZ"),
        ("PERI", _g(1 / channel.frequency_hz) + "S"),
        ("AMP", _g(channel.amplitude_vpp) + "V"),
    ]
    if shape in _RMS:
        fields.append(("AMPVRMS", _g(channel.amplitude_vpp * _RMS[shape]) + "Vrms"))
    fields += [
        ("OFST", _g(channel.offset_v) + "V"),
        ("HLEV", _g(high) + "V"),
        ("LLEV", _g(low) + "V"),
        ("PHSE", _g(channel.phase_deg)),
    ]
    return _joined(fields)


def _joined(fields: Pairs) -> str:
    return ",".join(word for pair in fields for word in pair)


def change_rate(channel: SdgChannel, pairs: Pairs) -> None:
    """Do ``SRATE``."""
    for key, value in pairs:
        number = number_of(value)
        if key == "MODE" and value.upper() in ("DDS", "TARB"):
            channel.rate_mode = value.upper()
        elif key == "INTER" and value.upper() in ("LINE", "HOLD"):
            channel.inter = value.upper()
        elif key == "VALUE" and number is not None:
            clamped = min(max(number, 1e-6), channel.model.max_arb_rate_hz)
            channel.arb_rate_hz = round_to_step(clamped, 1e-6)


def shown_rate(channel: SdgChannel) -> str:
    """Answer ``SRATE?``."""
    if channel.rate_mode == "DDS":
        return "MODE,DDS"
    return f"MODE,TARB,VALUE,{_g(channel.arb_rate_hz, 10)}Sa/s,INTER,{channel.inter}"


def change_arb(channel: SdgChannel, pairs: Pairs) -> None:
    """Do ``ARWV``: the waveform, which is then the shape.

    Raises
    ------
    ScpiError
        -224 for a waveform that is not there.
    """
    for key, value in pairs:
        if key == "NAME":
            channel.waves.codes(value)
            channel.arb_name = value
            channel.set_function("ARB")


def shown_arb(channel: SdgChannel) -> str:
    """Answer ``ARWV?``."""
    return f"INDEX,2,NAME,{channel.arb_name}"


def change_burst(channel: SdgChannel, pairs: Pairs) -> None:
    """Do ``BTWV``, but for a trigger; while it is off, nothing else of it changes."""
    for key, value in pairs:
        number, word = number_of(value), value.upper()
        if key == "STATE":
            channel.burst = word == "ON"
        elif not channel.burst:
            return
        elif key == "TRSR" and word in ("INT", "EXT", "MAN"):
            channel.trigger_source = word
        elif key == "GATE_NCYC" and word in ("NCYC", "GATE"):
            channel.gate = word
        elif key == "TRMD" and word in ("OFF", "RISE", "FALL"):
            channel.trigger_output = word
        elif key == "EDGE" and word in ("RISE", "FALL"):
            channel.edge = word
        elif key == "TIME" and word == "INF":
            channel.burst_cycles = math.inf
        elif number is not None:
            _change_burst_number(channel, key, number)


def _change_burst_number(channel: SdgChannel, key: str, number: float) -> None:
    if key == "TIME":
        channel.burst_cycles = float(min(max(round(number), 1), 1_000_000))
    elif key == "DLAY":
        clamped = min(max(number, 0.0), _MOST_DELAY_S)
        channel.trigger_delay_s = round_to_step(clamped, channel.model.delay_step_s)
    elif key == "PRD":
        channel.burst_period_s = min(max(number, 1e-6), 1000.0)
    elif key == "STPS":
        channel.burst_phase_deg = min(max(number, 0.0), 360.0)


def shown_burst(channel: SdgChannel) -> str:
    """Answer ``BTWV?``; what does not matter now is left out."""
    if not channel.burst:
        return "STATE,OFF"
    cycles = "INF" if math.isinf(channel.burst_cycles) else f"{channel.burst_cycles:.0f}"
    edge = ("EDGE", channel.edge) if channel.trigger_source == "EXT" else ("TRMD", channel.trigger_output)
    fields = [
        ("STATE", "ON"),
        ("PRD", _g(channel.burst_period_s) + "S"),
        ("STPS", _g(channel.burst_phase_deg)),
        ("TRSR", channel.trigger_source),
        edge,
        ("TIME", cycles),
        ("DLAY", _g(channel.trigger_delay_s) + "S"),
        ("GATE_NCYC", channel.gate),
    ]
    return f"{_joined(fields)},CARR,{shown_wave(channel)}"
