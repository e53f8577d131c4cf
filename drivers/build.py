"""From a bench file to real drivers, over whatever endpoints there are."""

from __future__ import annotations

from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING, Any

from belahil.bench import Bench, setting_per_cut_volt
from belahil.errors import InstrumentError, LimitExceeded
from belahil.generators import FAMILIES, family_of, model_of
from belahil.oscilloscopes import SCOPES, scope_spec
from belahil.receiver import receiver_preset

if TYPE_CHECKING:
    from belahil.bench import Endpoints
    from belahil.config import BenchConfig
    from belahil.interfaces import Digitizer, Link
    from drivers.generators.verified import VerifiedGenerator
    from drivers.oscilloscopes.scope import ScopeDigitizer


def bench(config: BenchConfig, endpoints: Endpoints) -> Bench:
    """Open both instruments of a bench file, the digitizer first.

    Parameters
    ----------
    config : BenchConfig
        ``[emulation]`` is not read.
    endpoints : Endpoints
        Where vendor libraries find emulated devices; empty for those that the bench file names.

    Returns
    -------
    Bench
        With its output off.

    Raises
    ------
    ConfigError
        An address or a link that is none.
    InstrumentError
        Nobody answers, or somebody unknown does; what was opened is closed again, its output off.
    """
    with ExitStack() as opened:
        # A receiver serves one client: it refuses a second program before that has touched the generator.
        digitizer = open_digitizer(config, endpoints)
        opened.callback(digitizer.close)
        generator = open_generator(config, endpoints)
        opened.callback(generator.close)
        made = Bench(generator, digitizer, config, endpoints.clock, endpoints.links)
        opened.pop_all()
        return made


def open_generator(config: BenchConfig, endpoints: Endpoints) -> VerifiedGenerator:
    """Open the generator: output off, load and its own voltage limits set.

    Raises
    ------
    InstrumentError
        Nobody answers, or a generator of another family does; then its output is off.
    """
    from drivers.generators.families import dialect_of
    from drivers.generators.verified import VerifiedGenerator
    from drivers.scpi import ScpiSession

    part = config.generator
    address = endpoints.visa_address or part.address
    library = endpoints.visa_library or part.visa_library
    link, _ = endpoints.links.opened("generator", lambda: _visa_link(address, library))
    with ExitStack() as opened:
        opened.callback(link.close)
        session = ScpiSession(link, endpoints.clock, address)
        found = _family_at(session.identity, part.driver)
        generator = VerifiedGenerator(
            session,
            dialect_of(found),
            part.load_ohm,
            largest_v=part.max_vpp / 2 * setting_per_cut_volt(config),
        )
        opened.pop_all()
    if found != part.driver:
        generator.close()
        raise InstrumentError(
            f'[generator] driver = "{part.driver}" is for {", ".join(FAMILIES[part.driver])}; '
            f'at {address} is "{generator.identity}"'
        )
    return generator


def _family_at(identity: str, driver: str) -> str:
    """Return the family of the instrument that answered; `driver` for an unknown one, refused later."""
    with suppress(LimitExceeded):
        return family_of(model_of(identity))
    return driver


def _visa_link(address: str, library: Any) -> tuple[Link, str]:
    from drivers.visa_link import VisaLink

    return VisaLink(address, library), "lines"


def open_digitizer(config: BenchConfig, endpoints: Endpoints) -> Digitizer:
    """Open the receiver, or the oscilloscope at its output."""
    if config.digitizer.driver in SCOPES:
        return open_scope(config, endpoints)
    from drivers.grm import GrmDigitizer

    link, framing = endpoints.links.opened("digitizer", lambda: _grm_link(config, endpoints))
    return GrmDigitizer(link, endpoints.clock, "raw" if framing == "raw" else "cobs")


def _grm_link(config: BenchConfig, endpoints: Endpoints) -> tuple[Link, str]:
    from drivers.links_grm import open_link
    from drivers.serial_link import open_serial
    from drivers.usb_link import open_usb

    if endpoints.serial_url:
        return open_serial(endpoints.serial_url), "cobs"
    if endpoints.usb_backend is not None:
        vendor, product = endpoints.usb_id
        return open_usb(vendor, product, backend=endpoints.usb_backend), "raw"
    return open_link(config.digitizer.link)


def open_scope(config: BenchConfig, endpoints: Endpoints) -> ScopeDigitizer:
    """Open an oscilloscope: its settings are sent with the first window.

    Raises
    ------
    InstrumentError
        Nobody answers, or an oscilloscope of another family.
    """
    from drivers.oscilloscopes.families import DIALECTS
    from drivers.oscilloscopes.scope import ScopeDigitizer
    from drivers.scpi import ScpiSession

    part = config.digitizer
    preset = receiver_preset(part.receiver)
    address = endpoints.visa_scope_address or part.link.removeprefix("visa:")
    library = endpoints.visa_library or config.generator.visa_library
    link, _ = endpoints.links.opened("digitizer", lambda: _visa_link(address, library))
    with ExitStack() as opened:
        opened.callback(link.close)
        scope = ScopeDigitizer(
            ScpiSession(link, endpoints.clock, address),
            endpoints.clock,
            DIALECTS[part.driver],
            scope_spec(part, preset),
            part.full_scale_v or preset.adc_full_scale_v,
        )
        opened.pop_all()
    return scope
