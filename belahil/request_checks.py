"""What a receiver that says what it can do would refuse, before it is asked."""

from __future__ import annotations

from typing import TYPE_CHECKING

from belahil.errors import LimitExceeded
from belahil.stimuli import Stimulus, TransmittedPulse

if TYPE_CHECKING:
    from belahil.receiver import DigitizerSpec
    from belahil.values import Trigger, WindowRequest


def check_window_request(
    stimulus: Stimulus, request: WindowRequest, trigger: Trigger, spec: DigitizerSpec
) -> None:
    """Refuse a window that a receiver cannot take.

    Parameters
    ----------
    stimulus : Stimulus
        What is played.
    request : WindowRequest
        The window.
    trigger : {"immediate", "generator", "digitizer"}
        Who starts it.
    spec : DigitizerSpec
        What the receiver can do.

    Raises
    ------
    RefusedInput
        One line with what was asked and what is allowed; `LimitExceeded`.
    """
    request.check()
    if (
        request.gain_code is not None
        and spec.gain_codes is not None
        and request.gain_code not in spec.gain_codes
    ):
        raise LimitExceeded(f"gain code {request.gain_code}: the receiver has {_span(spec.gain_codes)}")
    if not 0 < request.sample_count <= spec.max_sample_count:
        raise LimitExceeded(
            f"a window of {request.sample_count} samples: the receiver takes 1 to {spec.max_sample_count}"
        )
    if trigger not in spec.triggers:
        raise LimitExceeded(
            f"a window of {type(stimulus).__name__} is started by trigger = {trigger}: "
            f"the receiver has {', '.join(spec.triggers)}"
        )
    if isinstance(stimulus, TransmittedPulse) != (request.source == "transmit"):
        raise LimitExceeded(
            f"a window of {type(stimulus).__name__} with source = {request.source}: "
            "allowed: transmit for TransmittedPulse, return for all else"
        )
    if request.products not in spec.products:
        raise LimitExceeded(f"products = {request.products}: the receiver has {', '.join(spec.products)}")


def _span(codes: tuple[int, ...]) -> str:
    if codes == tuple(range(codes[0], codes[-1] + 1)):
        return f"gain codes {codes[0]} to {codes[-1]}"
    return "gain codes " + ", ".join(map(str, codes))
