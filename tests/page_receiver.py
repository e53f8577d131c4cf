"""A receiver written from ``docs/grm-link.md`` alone: its offsets and numbers, and the Python it prints.

It imports nothing of the project, so that the page and the code can be held against each other.
"""

from __future__ import annotations

import re
import struct
from pathlib import Path

PAGE = (Path(__file__).parent.parent / "docs" / "grm-link.md").read_text(encoding="utf-8")
_CODE: dict = {}
for _block in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL):
    exec(_block, _CODE)
cobs_encode, cobs_decode, crc16, crc32 = (
    _CODE[name] for name in ("cobs_encode", "cobs_decode", "crc16", "crc32")
)


class PageReceiver:
    """80 MHz, 12 bits, two converters, gain codes 0 to 15, windows of up to 16064 samples.

    It also reports the largest count of a window as a candidate, with five counts round it.

    `digitize(shot, code, count)` returns the counts; triggers come at once.
    """

    def __init__(self, digitize, usb: bool, part_octets: int = 1000) -> None:
        self.digitize = digitize
        self.usb = usb
        self.part_octets = part_octets
        self.line = b""
        self.out = b""
        self.sequence_count = 0
        self.armed: tuple | None = None

    # The four verbs of a link, seen from the client.

    def write(self, data: bytes) -> None:
        if self.usb:
            self.command(data)
            return
        *pieces, self.line = (self.line + data).split(b"\0")
        for piece in filter(None, pieces):
            try:
                self.command(cobs_decode(piece))
            except ValueError:
                continue

    def read(self, count: int, timeout_s: float) -> bytes:
        if not self.out and self.armed:
            self.send_window()
        data, self.out = self.out[:count], self.out[count:]
        return data

    def clear(self) -> None:
        self.out = b""

    def close(self) -> None:
        pass

    # Sections 4 to 8.

    def command(self, packet: bytes) -> None:
        if len(packet) < 13 or packet[:2] != b"\x18\x64" or packet[2] >> 6 != 3 or packet[6] >> 4 != 2:
            return
        if int.from_bytes(packet[4:6], "big") != len(packet) - 7 or crc16(packet):
            return
        number, service, subtype, data = packet[:4], packet[7], packet[8], packet[11:-2]
        if service != 200 or subtype not in (1, 2, 3, 4, 5):
            self.refuse(number, 1, "no such command")
        elif len(data) != (20 if subtype == 3 else 0):
            self.refuse(number, 2, "wrong length")
        elif subtype == 1:
            self.send(200, 129, number + b"Receiver from the page")
        elif subtype == 2:
            spec = struct.pack(">dIBBBBB", 80e6, 16064, 12, 2, 0b001, 0b1101, 16)
            self.send(200, 130, number + spec + bytes(range(16)))
        elif subtype == 3:
            self.arm(number, data)
        elif subtype == 4:
            self.send(200, 132, number + self.table())
        else:
            self.armed, self.out = None, b""
            self.send(1, 1, number)

    def arm(self, number: bytes, data: bytes) -> None:
        shot, code, trigger, source, products, count, _ = struct.unpack(">IBBBBId", data)
        self.armed = None
        for wrong, reason, text in (
            (code > 15, 3, "gain codes are 0 to 15"),
            (not 1 <= count <= 16064, 4, "1 to 16064 samples"),
            (trigger != 0, 6, "immediate only"),
            (source != 0, 7, "return only"),
            (products not in (0, 2, 3), 8, "windows, correlation windows, or both"),
            (products > 1 and count < 5, 4, "at least 5 samples to look for a pulse"),
        ):
            if wrong:
                self.refuse(number, reason, text)
                return
        self.armed = number, shot, code, count, products
        self.send(1, 1, number)

    def send_window(self) -> None:
        number, shot, code, count, products = self.armed
        self.armed = None
        counts, found = [int(value) for value in self.digitize(shot, code, count)], b""
        if products:
            largest = counts.index(max(counts))
            first = min(max(largest - 2, 0), count - 5)
            found = struct.pack(">dddIH", largest * 12.5e-9, 25e-9, counts[largest] * 2 / 4096, first, 5)
            found += struct.pack(">5h", *counts[first : first + 5])
            if products == 2:
                counts = []
        payload = (
            struct.pack(">IBBBBII", shot, code, bool(found), bool(found), 0, len(counts), 0)
            + struct.pack(">dddd", 2 / 4096, 0.0, 12.5e-9, 0.0)
            + struct.pack(f">{len(counts)}H", *(value + 32768 for value in counts))
            + found
            + self.table()
        )
        parts = [payload[at : at + self.part_octets] for at in range(0, len(payload), self.part_octets)]
        checksum = crc32(payload)
        for index, part in enumerate(parts):
            flags = 3 if len(parts) == 1 else 1 if index == 0 else 2 if index == len(parts) - 1 else 0
            head = struct.pack(">IHHI", shot, index, len(parts), checksum)
            self.send(200, 131, number + head + part, flags)

    def table(self) -> bytes:
        return b"\x01\x08supply_v" + struct.pack(">d", 28.0)

    def refuse(self, number: bytes, reason: int, text: str) -> None:
        self.send(1, 2, number + reason.to_bytes(2, "big") + text.encode())

    def send(self, service: int, subtype: int, data: bytes, flags: int = 3) -> None:
        rest = bytes([0x20, service, subtype]) + bytes(11) + data
        packet = struct.pack(">HHH", 0x0864, flags << 14 | self.sequence_count, len(rest) + 1) + rest
        packet += crc16(packet).to_bytes(2, "big")
        self.sequence_count = (self.sequence_count + 1) % 16384
        self.out += packet if self.usb else b"\0" + cobs_encode(packet) + b"\0"
