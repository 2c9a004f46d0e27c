#!/usr/bin/env python3
"""Test vectors of the wires: what every byte must be, calculated without the project's code.

This is a second implementation of docs/interfaces.md and of the original "Mapping robot
documentation" v1.0.0 ("document" below), written from their tables with nothing but integers,
exact fractions, `struct` and `zlib`. It shares no line, no table and no language with `fw-core`;
what both agree on is therefore what the tables say. `tests/vectors/README.md` describes the files.

    python3 tests/vectors/generate.py           writes the .json files beside it
    python3 tests/vectors/generate.py --check   fails if they are not what it would write

A few results derived by hand, so that this program is not its own witness either; each is an
`assert` in `by_hand()`:

  position, -1.234 mm, 500 mm, a quarter turn, apply (document, 5.1.1)
      x = -1234 um = 2^32 - 1234 = 0xFFFFFB2E (1234 = 0x4D2, inverted FB2D, plus one)
      y = 500 000 um = 0x0007A120 (7 * 65536 = 458 752, rest 41 248 = 0xA120)
      rotation = 0x8000 / 4 = 0x2000, bit 15 set for apply: 0xA000
      FF FF FB 2E  00 07 A1 20  A0 00
  battery, second cell at 7.4 V (5.1.3)
      index 1 << 13 = 0x2000, 7.4 * 200 = 1480 = 0x5C8: 25 C8
  distance, 1000 mm (5.1.4)
      1000 * 65535 / 2500 = 26 214 = 0x6666: 66 66
  distance, 250 mm: 6553.5, a tie, up: 6554 = 0x199A
  double, 50 % (5.1.2)
      50 = 1.5625 * 2^5: exponent 1023 + 5 = 0x404, fraction 0.5625 = 0x9: 0x4049000000000000
      least significant byte first: 00 00 00 00 00 00 49 40
  velocity, 123.456 mm/s, -45 degrees/s
      123 456 um/s = 0x0001E240 (65 536 rest 57 920 = 0xE240)
      -1/8 turn/s * 2^32 = -0x20000000 = 0xE0000000
      00 01 E2 40  E0 00 00 00  00 00
  gyro, -1.5 turns: -1.5 * 2^24 = -0x1800000 = 0xFE800000: FE 80 00 00
      128 turns = 2^31: wraps to 0x80000000, which is none: 80 00 00 01
  CRC-16/IBM-3740 of one byte 0x00: the register 0xFFFF, eight shifts
      FFFF -> FFFE^1021 = EFDF -> DFBE^1021 = CF9F -> 9F3E^1021 = 8F1F -> 1E3E^1021 = 0E1F
           -> 1C3E -> 387C -> 70F8 -> E1F0                                   = 0xE1F0
  a whole frame, mode 1, Pi to STM: key 96, 50 %, cell 1 not tuned
      96  00 00 00 00 00 00 49 40  20 00
"""
import json
import os
import struct
import sys
import zlib
from fractions import Fraction as F

HERE = os.path.dirname(os.path.abspath(__file__))
COMMAND, REPORT = "pi_to_stm", "stm_to_pi"

# ------------------------------------------------------------------------------ numbers and codes


def nearest(exact):
    """The nearest integer, a tie towards plus infinity."""
    return (exact + F(1, 2)).__floor__()


def length_code(mm):
    return max(-(2**31), min(2**31 - 1, nearest(mm * 1000)))


def rotation_code(turn):
    code = nearest(turn * 0x8000)
    return 0 if code == 0x8000 else code


def voltage_code(volts):
    return min(0x1FFF, nearest(volts * 200))


def distance_code(mm):
    """`None` = no echo or not yet measured."""
    if mm is None or mm < 0:
        return 0xFFFF
    return min(0xFFFF, nearest(mm * 65535 / 2500))


def bearing_code(turn):
    return nearest(turn * 0x10000) % 0x10000


NO_GYRO = -(2**31)


def gyro_code(turns):
    """`None` = no gyroscope or no bias yet."""
    if turns is None:
        return NO_GYRO
    code = (nearest(turns * 2**24) + 2**31) % 2**32 - 2**31
    return NO_GYRO + 1 if code == NO_GYRO else code


def double_bytes(number):
    return struct.pack("<d", number)


def double_bits(number):
    return "0x%016X" % struct.unpack("<Q", double_bytes(number))


def crc16(data):
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1
            crc &= 0xFFFF
    return crc


# ------------------------------------------------------------------- strategies and modes (5.1, 5.2)

FAULTS = [
    "LINK_LOST", "CLOCK_FALLBACK", "FRAME_REJECTED", "BATTERY_LOW", "BATTERY_CUTOFF",
    "LEFT_STALLED", "RIGHT_STALLED", "ENCODER_JUMP", "LEFT_REVERSED", "RIGHT_REVERSED",
    "LOG_DROPPED", "RESTARTED", "SLIP", "GYRO_LOST",
]
STATES = ["booting", "ready", "moving", "stopped", "faulted"]
ORDERS = ["none", "stop", "resume"]

BYTES = {
    "transmission key": 1, "position": 10, "double": 8, "battery": 2, "distance front": 2,
    "distance right": 2, "distance left": 2, "all data used": 0, "sequence": 2, "status": 3,
    "bearing": 2, "crc": 2, "velocity": 10, "gyro": 4,
}
KEY, END, RANGES = "transmission key", "all data used", ["distance front", "distance right", "distance left"]
GUARD = ["sequence", "status"]
CHAINS = {
    0x00: [KEY, "position", "battery", *RANGES, END],
    0x01: [KEY, "double", "battery", END],
    0x02: [KEY, "double", "battery", END],
    0x10: [KEY, *GUARD, "position", "battery", *RANGES, "crc", END],
    0x11: [KEY, *GUARD, "double", "battery", "crc", END],
    0x12: [KEY, *GUARD, "double", "battery", "crc", END],
    0x20: [KEY, *GUARD, "position", "battery", "distance front", "bearing", "crc", END],
    0x30: [KEY, *GUARD, "velocity", "gyro", "battery", "distance front", "bearing", *RANGES[1:], "crc", END],
}
NAMES = {
    0x00: "Normal", 0x01: "TuneRotatePID", 0x02: "TuneMovePID", 0x10: "Guarded Normal",
    0x11: "Guarded TuneRotate", 0x12: "Guarded TuneMove", 0x20: "Guarded Sweep",
    0x30: "Guarded Velocity",
}
SETUP = {"key_from_pi": 0x96, "key_from_stm": 0x5A, "cells": 8}


def be(value, size):
    return (value % (1 << 8 * size)).to_bytes(size, "big")


def write(strategy, direction, setup, values, before):
    """The bytes of one strategy."""
    command = direction == COMMAND
    v = values
    if strategy == KEY:
        return bytes([setup["key_from_pi" if command else "key_from_stm"]])
    if strategy == "velocity" and command:
        return be(v["forward"], 4) + be(v["yaw_rate"], 4) + b"\0\0"
    if strategy in ("position", "velocity"):
        top = 0x8000 if command and v["apply"] else 0
        return be(v["x"], 4) + be(v["y"], 4) + be(top | v["rotation"], 2)
    if strategy == "double":
        return struct.pack("<Q", int(v["double"], 16))
    if strategy == "battery":
        return be(v["cell"] << 13 | v["voltage"], 2)
    if strategy.startswith("distance"):
        return b"\0\0" if command else be(v["distance " + strategy.split()[1]], 2)
    if strategy == "bearing":
        return be(v.get("sweep", 0) if command else v["bearing"], 2)
    if strategy == "gyro":
        return b"\0\0\0\0" if command else be(v["gyro"], 4)
    if strategy == "sequence":
        return bytes([v["own"], v["seen"]])
    if strategy == "status":
        if command:
            return be(v["clear_faults"], 2) + bytes([ORDERS.index(v["order"])])
        flags = 0x40 * v.get("obstacle_limited", False) | 0x80 * v.get("clipped", False)
        return be(v["faults"], 2) + bytes([STATES.index(v["state"]) | flags])
    if strategy == "crc":
        return be(crc16(before), 2)
    assert strategy == END
    return b""


class Rejected(Exception):
    def __init__(self, strategy, offset, cause):
        super().__init__(strategy, offset, cause)
        self.strategy, self.offset, self.cause = strategy, offset, cause

    def json(self):
        return {"strategy": self.strategy, "offset": self.offset, "cause": self.cause}


def read(strategy, direction, setup, last, frame, at):
    """What one strategy's bytes at `at` say."""
    command = direction == COMMAND
    b = frame[at:at + BYTES[strategy]]
    if len(b) < BYTES[strategy]:
        raise Rejected(strategy, at, "short")
    if strategy == KEY:
        if b[0] != setup["key_from_pi" if command else "key_from_stm"]:
            raise Rejected(strategy, at, "key")
        return {}
    if strategy == "velocity" and command:
        forward, yaw_rate, reserved = struct.unpack(">iiH", b)
        if reserved:
            raise Rejected(strategy, at + 8, "velocity")
        return {"forward": forward, "yaw_rate": yaw_rate}
    if strategy in ("position", "velocity"):
        x, y, rotation = struct.unpack(">iiH", b)
        values = {"x": x, "y": y, "rotation": rotation & 0x7FFF}
        if command:
            values["apply"] = rotation >= 0x8000
        return values
    if strategy == "double":
        (bits,) = struct.unpack("<Q", b)
        if bits >> 52 & 0x7FF == 0x7FF:
            raise Rejected(strategy, at, "double")
        if command and abs(F(struct.unpack("<d", b)[0])) > 100:
            raise Rejected(strategy, at, "double")
        return {"double": "0x%016X" % bits}
    if strategy == "battery":
        word = b[0] << 8 | b[1]
        if word >> 13 >= setup["cells"]:
            raise Rejected(strategy, at, "cell")
        return {"cell": word >> 13, "voltage": word & 0x1FFF}
    if strategy.startswith("distance"):
        return {} if command else {"distance " + strategy.split()[1]: b[0] << 8 | b[1]}
    if strategy == "bearing":
        return {"sweep" if command else "bearing": b[0] << 8 | b[1]}
    if strategy == "gyro":
        return {} if command else {"gyro": struct.unpack(">i", b)[0]}
    if strategy == "sequence":
        if last is not None and not 1 <= (b[0] - last) % 256 <= 127:
            raise Rejected(strategy, at, "stale")
        return {"own": b[0], "seen": b[1]}
    if strategy == "status":
        codes, code = (ORDERS, b[2]) if command else (STATES, b[2] & 0x3F)
        if code >= len(codes):
            raise Rejected(strategy, at + 2, "status")
        bits = b[0] << 8 | b[1]
        if command:
            return {"clear_faults": bits, "order": codes[code]}
        flags = {"obstacle_limited": b[2] & 0x40, "clipped": b[2] & 0x80}
        return {"faults": bits, "state": codes[code], **{name: True for name, on in flags.items() if on}}
    if strategy == "crc":
        if (b[0] << 8 | b[1]) != crc16(frame[:at]):
            raise Rejected(strategy, at, "crc")
        return {}
    if len(frame) > at:
        raise Rejected(END, at, "long")
    return {}


def write_frame(mode, direction, setup, values):
    frame = b""
    for strategy in CHAINS[mode]:
        frame += write(strategy, direction, setup, values, frame)
    return frame


def read_frame(mode, direction, setup, last, frame):
    values, at = {}, 0
    for strategy in CHAINS[mode]:
        values.update(read(strategy, direction, setup, last, frame, at))
        at += BYTES[strategy]
    if mode == 0x20:
        values.pop("sweep", None)
    return values


def length_of(mode):
    return sum(BYTES[strategy] for strategy in CHAINS[mode])


def carried(mode, direction, values):
    """Those of `values` that the mode's frames carry."""
    kept = {}
    for strategy in CHAINS[mode]:
        names = {
            "position": ["x", "y", "rotation"] + (["apply"] if direction == COMMAND else []),
            "double": ["double"], "battery": ["cell", "voltage"], "sequence": ["own", "seen"],
            "status": ["clear_faults", "order"] if direction == COMMAND else ["faults", "state"],
            "bearing": ["bearing"] if direction == REPORT else ["sweep"] if mode == 0x30 else [],
            "velocity": ["forward", "yaw_rate"] if direction == COMMAND else ["x", "y", "rotation"],
            "gyro": ["gyro"] if direction == REPORT else [],
        }.get(strategy)
        if names is None:
            names = [strategy] if strategy.startswith("distance") and direction == REPORT else []
        kept.update({name: values[name] for name in names})
        if strategy == "status" and direction == REPORT:
            kept.update({flag: True for flag in ("obstacle_limited", "clipped") if values.get(flag)})
    return kept


# ------------------------------------------------------------------------------------- codes.json


def decimal(exact, digits=12):
    """An exact or 12-digit decimal text of a fraction."""
    scaled = nearest(abs(exact) * 10**digits)
    sign = "-" if exact < 0 else ""
    text = "%s%d.%0*d" % (sign, scaled // 10**digits, digits, scaled % 10**digits)
    return text.rstrip("0").rstrip(".")


def exact(text):
    return F(text)


def codes():
    def both(encode, decode, unit, values, code_list):
        return {
            "encode": [{unit: text, "code": encode(exact(text))} for text in values],
            "decode": [{"code": code, unit: decimal(decode(code), 16)} for code in code_list],
        }

    out = {}
    out["lengths"] = both(
        length_code, lambda code: F(code, 1000), "mm",
        # 0.0625 mm = 62.5 um is a tie that binary fractions hold exactly; so is every odd
        # multiple of it.
        ["0", "0.001", "-0.001", "1", "-1", "0.0625", "-0.0625", "0.1875", "-0.1875",
         "0.000499", "0.000501", "-0.000499", "-0.000501", "1234.5678", "-1234.5678",
         "2147483.647", "2147483.6474", "2147483.648", "2147484", "2147483647",
         "-2147483.648", "-2147483.6484", "-2147483.649", "-2147484", "-2147483648"],
        [0, 1, -1, 1000, -1000, 125, 126, -126, 999, -999, 123456789, -123456789,
         2**31 - 1, -(2**31)])
    half = F(1, 0x10000)
    turns = [F(0), half, half - F(1, 2**32), F(1, 0x8000), F(1, 4), F(1, 2), F(3, 4),
             3 * half, F(0x7FFF, 0x8000), F(0x7FFF, 0x8000) + half - F(1, 2**32),
             F(0x7FFF, 0x8000) + half, 1 - F(1, 2**32)]
    out["rotations"] = both(rotation_code, lambda code: F(code, 0x8000), "turn",
                            [decimal(turn, 32) for turn in turns],
                            [0, 1, 0x2000, 0x4000, 0x6000, 0x7FFE, 0x7FFF])
    out["voltages"] = both(
        voltage_code, lambda code: F(code, 200), "V",
        # 0.0625 V = 12.5 codes: a tie, and an odd multiple of it.
        ["0", "0.005", "0.002", "0.003", "0.0625", "0.1875", "3.0", "3.7", "4.2", "7.4", "8.4",
         "40.95", "40.955", "40.957", "40.958", "40.96", "41", "50", "65535"],
        [0, 1, 2, 740, 1480, 0xFF, 0x100, 0x1000, 0x1FFE, 0x1FFF])
    distances = both(
        distance_code, lambda code: F(code * 2500, 65535), "mm",
        # 250 mm = 6553.5 codes and 750 mm = 19660.5 are ties. 2499.980926 mm is 65534.5 codes.
        ["0", "0.01", "0.02", "0.0190", "0.0192", "1", "20", "250", "750", "1000", "1250", "2000",
         "2499", "2499.96", "2499.98", "2499.9809", "2499.981", "2499.99", "2500", "2500.1", "5000",
         "2147483647", "-0.001", "-1"],
        [0, 1, 2, 0x1FFF, 0x6666, 0x7FFF, 0x8000, 0xFFFD, 0xFFFE])
    distances["encode"].append({"mm": None, "code": 0xFFFF})
    distances["decode"].append({"code": 0xFFFF, "mm": None})
    out["distances"] = distances
    half = F(1, 0x20000)
    turns = [F(0), half, half - F(1, 2**32), F(1, 0x10000), F(1, 4), F(1, 2), F(3, 4),
             F(0xFFFF, 0x10000), F(0xFFFF, 0x10000) + half, 1 - F(1, 2**32)]
    out["bearings"] = both(bearing_code, lambda code: F(code, 0x10000), "turn",
                           [decimal(turn, 32) for turn in turns],
                           [0, 1, 0x4000, 0x8000, 0xC000, 0xFFFF])
    gyros = both(gyro_code, lambda code: F(code, 2**24), "turn",
                 # The third is half a code, a tie; 128 turns wrap, and to the code of none.
                 ["0", "0.5", "0.0000000298023223876953125", "-0.0000000298023223876953125", "-1.5", "127.9999",
                  "127.99999999", "128", "-128", "129.25", "-1000.125", "2147483647.5"],
                 [0, 1, -1, 2**24, -(2**31) + 1, 2**31 - 1])
    gyros["encode"].append({"turn": None, "code": NO_GYRO})
    gyros["decode"].append({"code": NO_GYRO, "turn": None})
    out["gyros"] = gyros
    samples = [b"", b"\0", b"\xFF", b"123456789", bytes(24), b"\xFF" * 24, bytes(range(24)),
               b"\x96\x01\x00\x00\x00\x00"]
    out["crc16"] = [{"bytes": data.hex(), "crc": crc16(data)} for data in samples]
    samples = [b"", b"\0", b"123456789", b"\xFF" * 0x334, bytes(range(256))]
    out["crc32"] = [{"bytes": data.hex(), "crc": zlib.crc32(data)} for data in samples]
    return out


# -------------------------------------------------------------------------------- strategies.json

DOUBLES = ["0.0", "-0.0", "1.0", "-1.0", "0.1", "-33.3", "50.0", "100.0", "-100.0", "99.99", "1e-300", "5e-324"]
MEASURES = ["359.99", "-123456.789", "1.7976931348623157e+308", "-1e-308", "360.0", "100.00000000000001"]


def strategies():
    out = []

    def add(name, strategy, direction, values, only=None, data=None, setup=SETUP, before=b"", physical=None):
        written = write(strategy, direction, setup, values, before) if data is None else data
        frame = before + written
        understood = read(strategy, direction, setup, None, frame, len(before))
        if only is None:
            assert {k: values[k] for k in understood} == understood, name
        else:
            values = understood
        entry = {"name": name, "strategy": strategy, "direction": direction, **setup}
        if before:
            entry["before"] = before.hex()
        if physical:
            entry["physical"] = physical
        entry.update({"values": values, "bytes": written.hex()})
        if only:
            entry["only"] = only
        out.append(entry)

    for pi, stm in [(0x96, 0x5A), (0x00, 0xFF), (0xFF, 0x00), (0x5A, 0x5A)]:
        for direction in (COMMAND, REPORT):
            keys = {"key_from_pi": pi, "key_from_stm": stm, "cells": 8}
            add("keys %02X and %02X" % (pi, stm), KEY, direction, {}, setup=keys)

    poses = [
        ("origin", "0", "0", "0"), ("one micrometre", "0.001", "0.001", "0.000030517578125"),
        ("minus one micrometre", "-0.001", "-0.001", "0.999969482421875"),
        ("back and right", "-1.234", "-500", "0.75"), ("the hand derivation", "-1.234", "500", "0.25"),
        ("ties go up", "0.0625", "-0.0625", "0.0000152587890625"),
        ("rounds to a whole turn", "1000", "-1000", "0.9999847412109375"),
        ("largest", "2147483.647", "2147483.647", "0.999969482421875"),
        ("smallest", "-2147483.648", "-2147483.648", "0.5"),
        ("saturates", "3000000", "-3000000", "0.125"),
        ("distinct bytes", "16909.06", "84281.096", "0.141265869140625"),
    ]
    for name, x, y, turn in poses:
        physical = {"x_mm": x, "y_mm": y, "turn": turn}
        values = {"x": length_code(F(x)), "y": length_code(F(y)), "rotation": rotation_code(F(turn))}
        for apply in (False, True):
            add(name + (", apply" if apply else ""), "position", COMMAND, {**values, "apply": apply}, physical=physical)
        add(name, "position", REPORT, values, physical=physical)
    add("not-used bit set by an original STM", "position", REPORT, None, "read", bytes.fromhex("0000000100000002ffff"))

    for text in DOUBLES:
        for direction in (COMMAND, REPORT):
            add(text, "double", direction, {"double": double_bits(float(text))}, physical={"number": text})
    for text in MEASURES:
        add(text, "double", REPORT, {"double": double_bits(float(text))}, physical={"number": text})

    for cell in range(8):
        volts = ["0", "0.005", "3.7", "7.4", "40.955", "0.0625", "41", "25.6"][cell]
        for direction in (COMMAND, REPORT):
            values = {"cell": cell, "voltage": voltage_code(F(volts))}
            add("cell %d at %s V" % (cell + 1, volts), "battery", direction, values, physical={"V": volts})
    for voltage in (0, 0xFF, 0x100, 0x1FFF):
        for direction in (COMMAND, REPORT):
            add("voltage code 0x%04X" % voltage, "battery", direction, {"cell": 0, "voltage": voltage})

    for strategy in RANGES:
        key = strategy
        add("dummy", strategy, COMMAND, {})
        add("a dummy of anything", strategy, COMMAND, None, "read", b"\xAB\xCD")
        for text in ["0", "20", "250", "1000", "2499.98", "2500", None]:
            code = distance_code(None if text is None else F(text))
            add("%s mm" % text if text else "no echo", strategy, REPORT, {key: code}, physical={"mm": text})
        for code in (0x0001, 0x1FFF, 0x8000, 0xFFFE, 0xFFFF):
            add("code 0x%04X" % code, strategy, REPORT, {key: code})

    for turn in ["0", "0.25", "0.0123", "0.5"]:
        add("sweep of %s turn to either side" % turn, "bearing", COMMAND, {"sweep": bearing_code(F(turn))},
            physical={"turn": turn})
    for turn in ["0", "0.25", "0.5", "0.75", "0.9999847412109375", "0.99999237060546875"]:
        add("%s turn" % turn, "bearing", REPORT, {"bearing": bearing_code(F(turn))}, physical={"turn": turn})

    for name, forward, yaw_rate in [
            ("standing", 0, 0), ("the hand derivation", 123_456, -(1 << 29)), ("distinct bytes", 0x01020304, 0x05060708),
            ("largest", 2**31 - 1, 2**31 - 1), ("smallest", -(2**31), -(2**31))]:
        add(name, "velocity", COMMAND, {"forward": forward, "yaw_rate": yaw_rate})
        pose = {"x": forward, "y": yaw_rate, "rotation": 0x2345}
        add(name, "velocity", REPORT, pose)
    add("dummy", "gyro", COMMAND, {})
    add("a dummy of anything", "gyro", COMMAND, None, "read", b"\xAB\xCD\xEF\x01")
    for text in ["0", "-1.5", "0.25", "127.75", "128", None]:
        add("%s turns" % text, "gyro", REPORT, {"gyro": gyro_code(None if text is None else F(text))},
            physical={"turn": text})

    for own, seen in [(1, 0), (0, 255), (255, 254), (128, 1), (77, 200)]:
        for direction in (COMMAND, REPORT):
            add("own %d, seen %d" % (own, seen), "sequence", direction, {"own": own, "seen": seen})

    for order in ORDERS:
        add("order " + order, "status", COMMAND, {"clear_faults": 0, "order": order})
        add("clear all, " + order, "status", COMMAND, {"clear_faults": 0xFFFF, "order": order})
    for state in STATES:
        add("state " + state, "status", REPORT, {"faults": 0, "state": state})
        add("all bits, " + state, "status", REPORT, {"faults": 0xFFFF, "state": state})
        for flags in [["obstacle_limited"], ["clipped"], ["obstacle_limited", "clipped"]]:
            add(", ".join([state, *flags]), "status", REPORT,
                {"faults": 0, "state": state, **{flag: True for flag in flags}})
    for bit, fault in enumerate(FAULTS):
        add("fault " + fault, "status", REPORT, {"faults": 1 << bit, "state": "ready"})
        add("clear " + fault, "status", COMMAND, {"clear_faults": 1 << bit, "order": "none"})

    for before in (b"", b"\0", b"123456789", bytes(range(24)), b"\xFF" * 24):
        for direction in (COMMAND, REPORT):
            add("over %d bytes" % len(before), "crc", direction, {}, before=before)
            add("after %d bytes" % len(before), END, direction, {}, before=before)
    return out


# ------------------------------------------------------------------------------------ frames.json

QUIET = {  # every value a frame can carry, at rest
    "x": 0, "y": 0, "rotation": 0, "apply": False, "double": double_bits(0.0), "cell": 0, "voltage": 0,
    "distance front": 0xFFFF, "distance right": 0xFFFF, "distance left": 0xFFFF, "bearing": 0,
    "own": 1, "seen": 0, "clear_faults": 0, "order": "none", "faults": 0, "state": "ready",
    "forward": 0, "yaw_rate": 0, "sweep": 0, "gyro": NO_GYRO,
}
BUSY = {  # every byte of it distinct from its neighbours
    "x": 0x01020304, "y": -0x05060708, "rotation": 0x1234, "apply": True, "double": double_bits(-12.3456789),
    "cell": 1, "voltage": 1480, "distance front": 0x1122, "distance right": 0x3344, "distance left": 0x5566,
    "bearing": 0xC0DE, "own": 0x42, "seen": 0x41, "clear_faults": 0x0A05, "order": "resume",
    "faults": 0x050A, "state": "moving", "forward": 0x11223344, "yaw_rate": -0x12233445, "sweep": 0x2AAB,
    "gyro": 0x61728394,
}
LARGEST = {
    "x": 2**31 - 1, "y": 2**31 - 1, "rotation": 0x7FFF, "apply": True, "double": double_bits(100.0),
    "cell": 7, "voltage": 0x1FFF, "distance front": 0xFFFE, "distance right": 0xFFFE,
    "distance left": 0xFFFE, "bearing": 0xFFFF, "own": 0xFF, "seen": 0xFF, "clear_faults": 0xFFFF,
    "order": "resume", "faults": 0xFFFF, "state": "faulted", "forward": 2**31 - 1, "yaw_rate": 2**31 - 1,
    "sweep": 0xFFFF, "gyro": 2**31 - 1,
}
SMALLEST = {
    **QUIET, "x": -(2**31), "y": -(2**31), "double": double_bits(-100.0), "cell": 0, "own": 0, "seen": 0xFF,
    "distance front": 0, "distance right": 0, "distance left": 0, "state": "booting",
    "forward": -(2**31), "yaw_rate": -(2**31), "gyro": -(2**31) + 1,
}


def frames():
    out = []

    def add(name, mode, direction, values, last=None, setup=SETUP, data=None, only=None):
        values = carried(mode, direction, values)
        data = write_frame(mode, direction, setup, values) if data is None else data
        assert len(data) == length_of(mode)
        assert read_frame(mode, direction, setup, last, data) == values, name
        entry = {"name": name, "mode": mode, "direction": direction, **setup}
        if "sequence" in CHAINS[mode]:
            entry["last"] = last
        entry.update({"values": values, "bytes": data.hex()})
        if only:
            entry["only"] = only
        out.append(entry)

    for mode in CHAINS:
        guarded = "sequence" in CHAINS[mode]
        for direction in (COMMAND, REPORT):
            add("at rest", mode, direction, QUIET)
            add("distinct bytes", mode, direction, BUSY, last=0x41)
            add("every field at its largest", mode, direction, LARGEST, last=0xFE)
            add("every field at its smallest", mode, direction, SMALLEST, last=0xFF)
            one = {"key_from_pi": 0x00, "key_from_stm": 0xFF, "cells": 1}
            add("one cell, other keys", mode, direction, {**BUSY, "cell": 0}, last=0x41, setup=one)
            for cell in range(8):
                add("cell %d of 8" % (cell + 1), mode, direction,
                    {**BUSY, "cell": cell, "voltage": 100 * cell + 1, "own": cell + 2}, last=cell + 1)
            if "position" in CHAINS[mode]:
                add("backwards, right, no apply", mode, direction,
                    {**BUSY, "x": -1, "y": -1234, "rotation": 0x6000, "apply": False}, last=0x41)
            if guarded:
                for own, last in [(0, 255), (1, 255), (127, 0), (126, 255), (255, 128), (0, None), (200, None)]:
                    add("counter %d after %s" % (own, last), mode, direction, {**BUSY, "own": own}, last=last)
                if direction == COMMAND:
                    for order in ORDERS:
                        add("order " + order, mode, direction, {**BUSY, "order": order}, last=0x41)
                else:
                    for state in STATES:
                        add("state " + state, mode, direction, {**BUSY, "state": state}, last=0x41)
                    for flags in (["obstacle_limited"], ["clipped"], ["obstacle_limited", "clipped"]):
                        add(", ".join(flags), mode, direction, {**BUSY, **{f: True for f in flags}}, last=0x41)
                    for bit, fault in enumerate(FAULTS):
                        add("fault " + fault, mode, direction, {**BUSY, "faults": 1 << bit}, last=0x41)
    # The examples of docs/interfaces.md.
    pose = {"x": -1234, "y": 500_000, "rotation": 0x2000, "apply": True}
    two = {**SETUP, "cells": 2}
    add("example: drive there", 0x00, COMMAND, {**QUIET, **pose}, setup=two)
    add("example: there, and what it sees", 0x00, REPORT,
        {**QUIET, **pose, "cell": 1, "voltage": voltage_code(F("3.7")), "distance front": distance_code(F(1000)),
         "distance left": distance_code(F(250))}, setup=two)
    add("example: half duty", 0x01, COMMAND, {**QUIET, "double": double_bits(50.0), "cell": 1}, setup=two)
    add("example: stopped", 0x11, REPORT,
        {**QUIET, "own": 5, "seen": 4, "faults": 1 << FAULTS.index("FRAME_REJECTED"), "state": "stopped",
         "double": double_bits(90.0), "voltage": voltage_code(F("3.7"))}, last=4, setup=two)
    add("example: drive a curve", 0x30, COMMAND,
        {**QUIET, "own": 5, "seen": 4, "forward": 120_000, "yaw_rate": 1 << 29, "sweep": 0x2AAB, "cell": 1},
        last=4, setup=two)
    # What an original end may send and ours never does.
    data = bytearray(write_frame(0, COMMAND, SETUP, BUSY))
    data[13:19] = b"\xDE\xAD\xBE\xEF\x12\x34"
    add("dummies of anything", 0, COMMAND, BUSY, data=bytes(data), only="read")
    data = bytearray(write_frame(0, REPORT, SETUP, BUSY))
    data[9] |= 0x80
    add("not-used bit set", 0, REPORT, BUSY, data=bytes(data), only="read")
    return out


# ---------------------------------------------------------------------------------- rejected.json


def rejected():
    out = []

    def add(name, mode, direction, data, last=None, clocked=None, expect=None, setup=SETUP):
        try:
            read_frame(mode, direction, setup, last, data + bytes((clocked or len(data)) - len(data)))
        except Rejected as why:
            if expect:
                assert expect == (why.strategy, why.cause), (name, why)
            entry = {"name": name, "mode": mode, "direction": direction, **setup}
            if "sequence" in CHAINS[mode]:
                entry["last"] = last
            entry["bytes"] = data.hex()
            if clocked:
                entry["clocked"] = clocked
            entry["rejected"] = why.json()
            out.append(entry)
        else:
            raise AssertionError(name)

    for mode in CHAINS:
        chain = CHAINS[mode]
        start = {s: sum(BYTES[t] for t in chain[:i]) for i, s in enumerate(chain)}
        guarded = "sequence" in chain

        def sealed(data):
            """With a checksum that is right again."""
            return bytes(data[:-2]) + be(crc16(data[:-2]), 2) if guarded else bytes(data)

        for direction in (COMMAND, REPORT):
            good = write_frame(mode, direction, SETUP, BUSY)

            def changed(at, *values):
                data = bytearray(good)
                data[at:at + len(values)] = values
                return sealed(data)

            for size in range(len(good)):
                add("%d bytes short" % (len(good) - size), mode, direction, good[:size], last=0x41)
            for more in (1, 2, 3, 7, 8):
                add("%d bytes long" % more, mode, direction, good + bytes(more), last=0x41, expect=(END, "long"))
            add("twice in one chip-select", mode, direction, good + good, last=0x41, expect=(END, "long"))
            if direction == COMMAND:
                for more in (1, 64, 1000):
                    add("%d clocks more than the buffer holds" % more, mode, direction, good, last=0x41,
                        clocked=len(good) + more, expect=(END, "long"))
            for bit in range(8):
                add("key with bit %d flipped" % bit, mode, direction, changed(0, good[0] ^ 1 << bit), last=0x41,
                    expect=(KEY, "key"))
            add("the other direction's key", mode, direction,
                changed(0, SETUP["key_from_stm" if direction == COMMAND else "key_from_pi"]), last=0x41,
                expect=(KEY, "key"))
            for cells in (1, 2, 7):
                few = {**SETUP, "cells": cells}
                data = write_frame(mode, direction, few, {**BUSY, "cell": cells})
                add("cell %d of %d" % (cells + 1, cells), mode, direction, data, last=0x41, setup=few,
                    expect=("battery", "cell"))
            if "double" in chain:
                specials = {"infinity": float("inf"), "minus infinity": float("-inf"), "NaN": float("nan")}
                for name, number in specials.items():
                    data = changed(start["double"], *double_bytes(number))
                    add(name, mode, direction, data, last=0x41, expect=("double", "double"))
                for bits in ("0x7FF0000000000001", "0xFFFFFFFFFFFFFFFF", "0x7FF8000000000000"):
                    data = changed(start["double"], *struct.pack("<Q", int(bits, 16)))
                    add("NaN " + bits, mode, direction, data, last=0x41, expect=("double", "double"))
                if direction == COMMAND:
                    for percent in (100.00000000000001, -100.00000000000001, 101.0, -1e300):
                        data = changed(start["double"], *double_bytes(percent))
                        add("%r %%" % percent, mode, direction, data, last=0x41, expect=("double", "double"))
            if not guarded:
                continue
            for last in (0x42, 0x43, 0x42 + 127, 0xC2, 0x42 + 1):
                add("counter 0x42 after 0x%02X" % last, mode, direction, good, last=last,
                    expect=("sequence", "stale"))
            for own, last in [(255, 0), (0, 0), (0, 128), (128, 0), (1, 1), (0, 1)]:
                data = write_frame(mode, direction, SETUP, {**BUSY, "own": own})
                add("counter %d after %d" % (own, last), mode, direction, data, last=last,
                    expect=("sequence", "stale"))
            count = len(ORDERS if direction == COMMAND else STATES)
            if "velocity" in chain and direction == COMMAND:
                for reserved in (b"\0\1", b"\x80\0", b"\xFF\xFF"):
                    add("velocity's last bytes " + reserved.hex(), mode, direction,
                        changed(start["velocity"] + 8, *reserved), last=0x41, expect=("velocity", "velocity"))
            for code in (count, count + 1, 0x80 if direction == COMMAND else 0x88, 0xFF):
                add("code %d where %d exist" % (code, count), mode, direction, changed(start["status"] + 2, code),
                    last=0x41, expect=("status", "status"))
            for at in range(len(good)):
                data = bytearray(good)
                data[at] ^= 1 << at % 8
                add("byte %d, bit %d flipped on the wire" % (at, at % 8), mode, direction, bytes(data), last=0x41)
            add("checksum's bytes exchanged", mode, direction, good[:-2] + good[:-3:-1], last=0x41,
                expect=("crc", "crc"))
            add("all ones", mode, direction, b"\xFF" * len(good), last=0x41)
        add("a line stuck low", mode, COMMAND, bytes(length_of(mode)), last=0x41, expect=(KEY, "key"))
        add("a line stuck high", mode, REPORT, b"\xFF" * length_of(mode), last=0x41, expect=(KEY, "key"))
    return out


# ---------------------------------------------------------------------------------- sessions.json


class End:
    """One end of a guarded link, as docs/interfaces.md describes it."""

    def __init__(self, mode, sends, setup):
        self.mode, self.sends, self.setup = mode, sends, setup
        self.own, self.last = 0, None
        self.row = []  # numbers of the stale frames in a row that are right otherwise
        self.counted = {"accepted": 0, "missed": 0, "rejected": {}}

    def send(self, values, again=False):
        if not again:
            self.own = (self.own + 1) % 256
        values = {**values, "own": self.own, "seen": self.last or 0}
        return write_frame(self.mode, self.sends, self.setup, values)

    def receive(self, frame):
        direction = REPORT if self.sends == COMMAND else COMMAND
        try:
            values = read_frame(self.mode, direction, self.setup, self.last, frame)
        except Rejected as why:
            if why.cause == "stale" and self.begins_anew(direction, frame):
                self.last = None
                return self.receive(frame)
            count = self.counted["rejected"]
            count[why.cause] = count.get(why.cause, 0) + 1
            raise
        self.counted["accepted"] += 1
        if "sequence" in CHAINS[self.mode]:
            if self.last is not None:
                self.counted["missed"] += (values["own"] - self.last - 1) % 256
            self.last, self.row = values["own"], []
        return values

    def begins_anew(self, direction, frame):
        try:
            own = read_frame(self.mode, direction, self.setup, None, frame)["own"]
        except Rejected:
            return False
        if own == self.last:
            self.row = []
        elif self.row and own == (self.row[-1] + 1) % 256:
            self.row.append(own)
        else:
            self.row = [own]
        return len(self.row) >= 4


def sessions():
    out = []

    class Session:
        def __init__(self, name, mode):
            self.name, self.mode, self.steps = name, mode, []
            self.ends = {}
            self.start("pi")
            self.start("stm")

        def start(self, end):
            self.ends[end] = End(self.mode, COMMAND if end == "pi" else REPORT, SETUP)
            self.steps.append({"end": end, "do": "start"})

        def send(self, end, again=False, **values):
            direction = COMMAND if end == "pi" else REPORT
            values = {**QUIET, **values}
            frame = self.ends[end].send(values, again)
            values = {k: v for k, v in carried(self.mode, direction, values).items() if k not in ("own", "seen")}
            self.steps.append({"end": end, "do": "resend" if again else "send", "values": values,
                               "bytes": frame.hex()})
            return frame

        def receive(self, end, frame):
            step = {"end": end, "do": "receive", "bytes": frame.hex()}
            try:
                step["values"] = self.ends[end].receive(frame)
            except Rejected as why:
                step["rejected"] = why.json()
            self.steps.append(step)

        def exchange(self, to_stm=True, to_pi=True):
            """One chip-select: the reply was written before the command arrives."""
            command, reply = self.send("pi"), self.send("stm")
            if to_stm:
                self.receive("stm", command)
            if to_pi:
                self.receive("pi", reply)
            return command, reply

        def many(self, times, to_stm=True, to_pi=True):
            """Exchanges at rest whose frames are not written down."""
            steps, self.steps = self.steps, []
            for _ in range(times):
                self.exchange(to_stm, to_pi)
            self.steps = [*steps, {"do": "exchange", "times": times, "to_stm": to_stm, "to_pi": to_pi}]

        def done(self):
            for end in ("pi", "stm"):
                self.steps.append({"end": end, "do": "counters", "counters": self.ends[end].counted})
            out.append({"name": self.name, "mode": self.mode, **SETUP, "steps": self.steps})

    for mode in CHAINS:
        s = Session("four frames each way", mode)
        for _ in range(4):
            s.exchange()
        s.done()
        s = Session("a torn frame costs itself alone", mode)
        s.exchange()
        frame = s.send("pi")
        s.receive("stm", frame[:len(frame) // 2])
        s.exchange()
        s.done()
    for mode in (0x10, 0x11, 0x12, 0x20, 0x30):
        s = Session("lost frames are counted", mode)
        s.exchange()
        for lost in (1, 2, 5):
            for _ in range(lost):
                s.exchange(to_stm=False, to_pi=False)
            s.exchange()
        s.done()
        s = Session("a repeated frame is stale, the next is not", mode)
        command, reply = s.exchange()
        s.receive("stm", command)
        s.receive("pi", reply)
        s.exchange()
        s.done()
        s = Session("an old frame is stale", mode)
        old, old_reply = s.exchange()
        s.exchange()
        s.exchange()
        s.receive("stm", old)
        s.receive("pi", old_reply)
        s.exchange()
        s.done()
        s = Session("a rejected frame leaves the counters of the sequence alone", mode)
        s.exchange()
        frame = bytearray(s.send("pi"))
        frame[-1] ^= 1
        s.receive("stm", bytes(frame))
        s.exchange()
        s.done()
        s = Session("a reply written again keeps its number", mode)
        s.exchange()
        s.send("stm", cell=0)
        s.send("stm", again=True, cell=1)
        reply = s.send("stm", again=True, cell=2)
        s.receive("pi", reply)
        s.exchange()
        s.done()
        s = Session("the Pi's program restarts", mode)
        s.many(20)
        s.start("pi")
        for _ in range(5):
            s.exchange()
        s.done()
        s = Session("the STM restarts", mode)
        s.many(20)
        s.start("stm")
        for _ in range(5):
            s.exchange()
        s.done()
    s = Session("both counters wrap", 0x11)
    s.many(253)
    for _ in range(5):
        s.exchange()
    s.done()
    s = Session("128 frames lost in a row: stale until four in a row restart the count", 0x11)
    s.exchange()
    s.many(128, to_stm=False)
    for _ in range(6):
        s.exchange()
    s.done()
    for lost in (128, 200, 251, 252, 253, 254, 255):
        s = Session("%d frames of both ends lost after the first" % lost, 0x11)
        s.exchange()
        s.many(lost, to_stm=False, to_pi=False)
        for _ in range(6):
            s.exchange()
        s.done()
    s = Session("both ends sent 128 frames unheard before the first", 0x11)
    s.many(128, to_stm=False, to_pi=False)
    for _ in range(5):
        s.exchange()
    s.done()
    s = Session("two old frames again and again never restart the count", 0x11)
    old = [s.exchange() for _ in range(2)]
    s.exchange()
    for _ in range(6):
        for command, reply in old:
            s.receive("stm", command)
            s.receive("pi", reply)
    s.exchange()
    s.done()
    s = Session("a wrong checksum in the row: it begins again behind it", 0x11)
    s.many(100)
    s.start("pi")
    for number in range(8):
        frame = bytearray(s.send("pi"))
        frame[-1] ^= number == 2
        s.receive("stm", bytes(frame))
    s.done()
    return out


# ------------------------------------------------------------------------------------ eeprom.json

U8, U16, U32, DOUBLE = "<B", "<H", "<I", "<d"


def bits(lowest, width=1):
    """So many bits of one byte."""
    return ("bits", lowest, width)


def width_of(kind):
    """Bits that a field has."""
    return kind[2] if isinstance(kind, tuple) else 8 * struct.calcsize(kind)


NEED_TAP = {"tap_%d.%s" % (n, which): n for n in range(1, 9) for which in ("upper", "lower")}
# address, type, name, smallest, largest, first board (6.0.1 to 6.0.3; page 0x03 is ours)
FIELDS = [
    (0x000A, U8, "key_from_pi", 0, 255, 0x96),
    (0x000B, U8, "key_from_stm", 0, 255, 0x5A),
    (0x000C, U8, "mode", None, None, 0),
    (0x0100, DOUBLE, "forward.p", 0.0, 10000.0, 6.5088),
    (0x0108, DOUBLE, "forward.i", 0.0, 10000.0, 0.073412),
    (0x0110, DOUBLE, "forward.d", 0.0, 10000.0, 106.72),
    (0x0118, DOUBLE, "forward.anti_windup", 0.0, 10000.0, 0.3),
    (0x0120, DOUBLE, "rotation.p", 0.0, 10000.0, 1.3686),
    (0x0128, DOUBLE, "rotation.i", 0.0, 10000.0, 0.0093263),
    (0x0130, DOUBLE, "rotation.d", 0.0, 10000.0, 50.209),
    (0x0138, DOUBLE, "rotation.anti_windup", 0.0, 10000.0, 1.4),
    (0x0203, U8, "cells", 1, 8, 2),
    (0x0204, DOUBLE, "adc_max", 0.1, 10.0, 3.3),
    (0x020C, U32, "adc_max_word", 1, 65535, 4095),
    *[field for n in range(1, 9) for field in (
        (0x0208 + 8 * n, U32, "tap_%d.upper" % n, 0, 10_000_000, {1: 10_000, 2: 33_000}.get(n, 2**32 - 1)),
        (0x020C + 8 * n, U32, "tap_%d.lower" % n, 1, 10_000_000, {1: 33_000, 2: 22_000}.get(n, 2**32 - 1)),
    )],
    (0x0300, U8, "layout_version", 2, 2, 2),
    (0x0301, U8, "layout_length", 0x52, 0x52, 0x52),
    (0x0302, U16, "counts_per_turn", 100, 60_000, 3840),
    (0x0304, U32, "wheel_diameter_left", 10_000, 1_000_000, 80_000),
    (0x0308, U32, "wheel_diameter_right", 10_000, 1_000_000, 80_000),
    (0x030C, U32, "track", 20_000, 2_000_000, 125_000),
    (0x0310, bits(0), "encoder_left_reversed", 0, 1, 1),
    (0x0310, bits(1), "encoder_right_reversed", 0, 1, 1),
    (0x0310, bits(2), "motor_left_reversed", 0, 1, 0),
    (0x0310, bits(3), "motor_right_reversed", 0, 1, 0),
    (0x0310, bits(4), "servo_reversed", 0, 1, 0),
    (0x0310, bits(5, 3), "signs_reserved", 0, 0, 0),
    (0x0311, U8, "rangefinders", 0, 3, 3),
    (0x0312, U16, "bearing_front", 0, 0xFFFF, 0x0000),
    (0x0314, U16, "bearing_right", 0, 0xFFFF, 0xC000),
    (0x0316, U16, "bearing_left", 0, 0xFFFF, 0x4000),
    (0x0318, U8, "servo", 0, 1, 0),
    (0x0319, U8, "gyro", 0, 1, 0),
    (0x031A, U16, "stop_deadline", 20, 2000, 250),
    (0x031C, U16, "dead_zone_left", 0, 9999, 1600),
    (0x031E, U16, "dead_zone_right", 0, 9999, 2300),
    (0x0320, U16, "limit_left", 1, 10_000, 10_000),
    (0x0322, U16, "limit_right", 1, 10_000, 10_000),
    (0x0324, U32, "log_baud", 9600, 2_000_000, 115_200),
    (0x0328, U16, "battery_warn", 0, 5000, 3400),
    (0x032A, U16, "battery_cutoff", 0, 5000, 3000),
    (0x032C, U16, "position_tolerance", 200, 65_535, 3000),
    (0x032E, U16, "rotation_tolerance", 8, 0x2000, 91),
    (0x0330, U16, "log_period", 0, 60_000, 0),
    (0x0332, U16, "servo_travel", 0, 0x8000, 0),
    (0x0334, U16, "stop_distance", 0, 2_000, 150),
    (0x0336, U16, "front_overhang", 0, 1_000, 20),
    (0x0338, U16, "reaction_time", 0, 1_000, 100),
    (0x033A, U16, "deceleration", 50, 10_000, 400),
    (0x033C, U16, "blind_speed", 0, 2_000, 100),
    (0x033E, U16, "reverse_speed", 0, 2_000, 50),
    (0x0340, U16, "reverse_distance", 0, 10_000, 300),
    (0x0342, U16, "max_speed", 10, 2_000, 200),
    (0x0344, U16, "max_yaw_rate", 0x100, 0x8000, 0x4000),
    (0x0346, U16, "acceleration", 50, 10_000, 400),
    (0x0348, U16, "yaw_acceleration", 0x100, 0xFFFF, 0x8000),
    (0x034A, U16, "full_speed_left", 1, 5_000, 134),
    (0x034C, U16, "full_speed_right", 1, 5_000, 169),
]
BY_NAME = {name: (address, kind, low, high) for address, kind, name, low, high, _ in FIELDS}
FIRST_BOARD = {name: value for _, _, name, _, _, value in FIELDS}
EEPROM_KEY = bytes([0x15, 0x26, 0x37, 0x48, 0x59, 0x6A, 0x7B, 0x8C, 0x9D, 0xAE])


def put(image, address, data):
    image[address:address + len(data)] = data


def checksum(image):
    """CRC-32 over the EEPROM key and every byte of a field, by address."""
    defined = set(range(10))
    for address, kind, _, _, _, _ in FIELDS:
        defined |= set(range(address, address + (width_of(kind) + 7) // 8))
    return zlib.crc32(bytes(image[address] for address in sorted(defined)))


def seal(image):
    put(image, 0x034E, struct.pack("<I", checksum(image)))


def image_of(config, original=False, background=0xFF):
    image = bytearray([background] * 0x400)
    put(image, 0, EEPROM_KEY)
    for address, kind, name, _, _, _ in FIELDS:
        if original and address >= 0x0300:
            continue
        if isinstance(kind, tuple):
            _, lowest, width = kind
            mask = ((1 << width) - 1) << lowest
            image[address] = image[address] & ~mask | config[name] << lowest
        else:
            put(image, address, struct.pack(kind, config[name]))
    if original:
        put(image, 0x0300, b"\xFF" * 0x52)
    else:
        seal(image)
    return image


def chunks(image):
    """What differs from 0xFF, as address: bytes; runs within 16-byte rows."""
    out = {}
    for row in range(0, len(image), 16):
        data = bytes(image[row:row + 16])
        if data.strip(b"\xFF"):
            first = next(i for i, byte in enumerate(data) if byte != 0xFF)
            out["0x%04X" % (row + first)] = data.strip(b"\xFF").hex()
    return out


def shown(name, value):
    return double_bits(value) if BY_NAME[name][1] == DOUBLE else value


def eeprom():
    accepted, refused = [], []

    def accept(name, config, original=False, only=None, image=None):
        image = image or image_of(config, original)
        entry = {"name": name, "original": original, "image": chunks(image),
                 "fields": {key: shown(key, value) for key, value in config.items()}}
        if only:
            entry["only"] = only
        accepted.append(entry)

    accept("first board, original (page 0x03 blank)", FIRST_BOARD, original=True)
    accept("first board, page 0x03 written", FIRST_BOARD)
    for mode in CHAINS:
        servo = 1 if mode == 0x20 else 0
        accept("mode 0x%02X" % mode, {**FIRST_BOARD, "mode": mode, "servo": servo})
    distinct = {
        **FIRST_BOARD, "mode": 0x20, "cells": 8, "key_from_pi": 0x01, "key_from_stm": 0x02,
        "forward.p": 1.5, "forward.i": 0.25, "forward.d": 1000.125, "forward.anti_windup": 0.1,
        "rotation.p": 2.5, "rotation.i": 0.0, "rotation.d": 9999.999, "rotation.anti_windup": 1e-9,
        "adc_max": 2.5, "adc_max_word": 0xFFFF,
        **{"tap_%d.upper" % n: 1_000_001 * n for n in range(1, 9)},
        **{"tap_%d.lower" % n: 100_002 * n for n in range(1, 9)},
        "counts_per_turn": 0x1234, "wheel_diameter_left": 81_234, "wheel_diameter_right": 79_876,
        "track": 234_567, "encoder_left_reversed": 0, "encoder_right_reversed": 0, "motor_left_reversed": 1,
        "motor_right_reversed": 1, "servo_reversed": 1, "rangefinders": 1, "bearing_front": 0x0102,
        "bearing_right": 0xC304, "bearing_left": 0x4506, "servo": 1, "stop_deadline": 777,
        "dead_zone_left": 1111, "dead_zone_right": 2222, "limit_left": 8888, "limit_right": 9999,
        "log_baud": 1_000_000, "battery_warn": 3555, "battery_cutoff": 3111,
        "position_tolerance": 4321, "rotation_tolerance": 1234, "log_period": 500, "servo_travel": 0x5678,
        "stop_distance": 201, "front_overhang": 31, "reaction_time": 121, "deceleration": 501, "blind_speed": 91,
        "reverse_speed": 41, "reverse_distance": 251, "max_speed": 301, "max_yaw_rate": 0x2345,
        "acceleration": 601, "yaw_acceleration": 0x6789, "full_speed_left": 151, "full_speed_right": 161,
    }
    accept("every field distinct, eight cells, sweep", distinct)
    low = {name: low for _, _, name, low, _, _ in FIELDS}
    accept("every field at its smallest", {**low, "mode": 0, **{
        name: 2**32 - 1 for name, tap in NEED_TAP.items() if tap > 1}})
    high = {name: high for _, _, name, _, high, _ in FIELDS}
    accept("every field at its largest", {**high, "mode": 0x20})
    accept("resistors exactly 99 to 1", {**FIRST_BOARD, "tap_1.upper": 99, "tap_1.lower": 1})
    accept("gains of minus zero", {**FIRST_BOARD, "forward.i": -0.0, "rotation.d": -0.0})
    accept("battery supervision off", {**FIRST_BOARD, "battery_warn": 0, "battery_cutoff": 0})
    accept("unused taps of anything", {**FIRST_BOARD, "tap_3.lower": 0, "tap_8.upper": 0xDEADBEEF})
    image = image_of(FIRST_BOARD, background=0x00)
    accept("undefined bytes of zero", FIRST_BOARD, only="read", image=image)
    image = image_of(FIRST_BOARD, original=True, background=0xA5)
    accept("original, undefined bytes of anything", FIRST_BOARD, original=True, only="read", image=image)
    image = image_of(FIRST_BOARD)
    put(image, 0x0352, bytes(range(0xAE)))
    accept("bytes beyond the layout of anything", FIRST_BOARD, only="read", image=image)

    def refuse(name, image, address, field, value):
        entry = {"name": name, "image": chunks(image), "address": "0x%04X" % address, "field": field,
                 "value": value}
        refused.append(entry)

    blank = bytearray(b"\xFF" * 0x400)
    refuse("an EEPROM never written", blank, 0, "EEPROM key", "ff" * 10)
    refuse("all zero", bytearray(0x400), 0, "EEPROM key", "00" * 10)
    for at in range(10):
        for original in (True, False):
            image = image_of(FIRST_BOARD, original)
            image[at] ^= 1 << at % 8
            refuse("EEPROM key, byte %d" % at, image, 0, "EEPROM key", bytes(image[:10]).hex())
    for at, bit in [(0x000A, 7), (0x0107, 6), (0x024F, 0), (0x0302, 0), (0x034D, 5)]:
        image = image_of(FIRST_BOARD)
        right = checksum(image)
        image[at] ^= 1 << bit
        refuse("0x%04X changed behind the checksum's back" % at, image, 0x034E, "crc", right)
    for byte in range(4):
        image = image_of(FIRST_BOARD)
        image[0x034E + byte] ^= 0x10
        (found,) = struct.unpack("<I", image[0x034E:0x0352])
        refuse("checksum, byte %d" % byte, image, 0x034E, "crc", found)
    # A page 0x03 that is not all blank is not an original one.
    image = image_of(FIRST_BOARD, original=True)
    image[0x0351] = 0xFE
    refuse("one bit of page 0x03 written", image, 0x0300, "layout_version", 0xFF)

    def field(name, value, also=None, original=False, why=None):
        image = image_of({**FIRST_BOARD, **(also or {}), name: value}, original)
        text = "%s = %r%s" % (name, value, why or "")
        refuse(text + (", original" if original else ""), image, BY_NAME[name][0], name, shown(name, value))

    for mode in (0x03, 0x0F, 0x13, 0x1F, 0x21, 0x2F, 0x31, 0xFF):
        field("mode", mode)
        field("mode", mode, original=True)
    for name, (address, kind, low, high) in BY_NAME.items():
        if low is None:
            continue
        everywhere = {"cells": 8, **{key: 1 for key in NEED_TAP}} if name in NEED_TAP else {}
        if kind == DOUBLE:
            for number in (float("nan"), float("inf"), float("-inf"), -1.0, high + 0.001, 1e300, -1e-9,
                           low - 0.001):
                for original in (True, False):
                    field(name, number, original=original)
            continue
        biggest = (1 << width_of(kind)) - 1
        candidates = sorted({low - 1, high + 1, biggest, 0})
        for value in (v for v in candidates if 0 <= v <= biggest and not low <= v <= high):
            field(name, value, everywhere)
            if address < 0x0300:
                field(name, value, everywhere, original=True)
    # What fields must hold together.
    for n in range(1, 9):
        taps = {"cells": 8, **{key: 1 for key in NEED_TAP}}
        field("tap_%d.upper" % n, 100, taps, why=" over 1")
    field("servo", 0, {"mode": 0x20}, why=" in mode 0x20")
    field("rangefinders", 0, {"mode": 0x20, "servo": 1}, why=" in mode 0x20")
    field("dead_zone_left", 500, {"limit_left": 500}, why=" at its limit")
    field("dead_zone_right", 501, {"limit_right": 500}, why=" above its limit")
    field("battery_cutoff", 3401, why=" above the warning")
    image = image_of({**FIRST_BOARD, "mode": 0x20}, original=True)
    refuse("mode 0x20 on an original image: the first board has no servo", image, 0x0318, "servo", 0)
    # The first of two is named: in the order key, layout, checksum, fields by address, rules.
    image = image_of({**FIRST_BOARD, "cells": 0, "track": 0})
    refuse("two fields", image, 0x0203, "cells", 0)
    image = image_of({**FIRST_BOARD, "battery_cutoff": 5000, "log_period": 60_001})
    refuse("a field and a rule", image, 0x0330, "log_period", 60_001)
    image = image_of({**FIRST_BOARD, "layout_version": 3, "mode": 0xFF})
    image[0x034E] ^= 1
    refuse("layout, checksum and a field", image, 0x0300, "layout_version", 3)
    # The layout before this one: its checksum covered every byte from 0x0000 to 0x0333.
    image = image_of({**FIRST_BOARD, "layout_version": 1, "layout_length": 0x38})
    put(image, 0x0334, struct.pack("<I", zlib.crc32(bytes(image[:0x0334]))))
    refuse("layout 1, right in itself", image, 0x0300, "layout_version", 1)
    return {"accepted": accepted, "rejected": refused}


# -------------------------------------------------------------------------------------------------


def by_hand():
    """The results of this file's head."""
    position = {"x": length_code(F("-1.234")), "y": length_code(F(500)), "rotation": rotation_code(F(1, 4)),
                "apply": True}
    assert write("position", COMMAND, SETUP, position, b"").hex() == "fffffb2e0007a120a000"
    battery = {"cell": 1, "voltage": voltage_code(F("7.4"))}
    assert write("battery", REPORT, SETUP, battery, b"").hex() == "25c8"
    assert distance_code(F(1000)) == 0x6666 and distance_code(F(250)) == 0x199A
    assert distance_code(F(2500)) == 0xFFFF and distance_code(F("2499.98")) == 0xFFFE
    velocity = {"forward": nearest(F("123.456") * 1000), "yaw_rate": nearest(F(-45, 360) * 2**32)}
    assert write("velocity", COMMAND, SETUP, velocity, b"").hex() == "0001e240e00000000000"
    assert write("gyro", REPORT, SETUP, {"gyro": gyro_code(F("-1.5"))}, b"").hex() == "fe800000"
    assert write("gyro", REPORT, SETUP, {"gyro": gyro_code(F(128))}, b"").hex() == "80000001"
    assert double_bytes(50.0).hex() == "0000000000004940"
    assert crc16(b"\0") == 0xE1F0 and crc16(b"123456789") == 0x29B1
    assert zlib.crc32(b"123456789") == 0xCBF43926
    frame = write_frame(1, COMMAND, SETUP, {"double": double_bits(50.0), "cell": 1, "voltage": 0})
    assert frame.hex() == "9600000000000049402000"
    assert [length_of(mode) for mode in CHAINS] == [19, 11, 11, 26, 18, 18, 24, 32]


def text_of(value, depth=0):
    """JSON with one vector a line."""
    pad = " " * (depth + 1)
    if isinstance(value, list):
        body = ",\n".join(pad + (text_of(v, depth + 1) if isinstance(v, dict) and "steps" in v
                                 else json.dumps(v)) for v in value)
        return "[\n" + body + "\n" + " " * depth + "]"
    body = ",\n".join(pad + json.dumps(k) + ": " + (
        text_of(v, depth + 1) if isinstance(v, (dict, list)) else json.dumps(v)) for k, v in value.items())
    return "{\n" + body + "\n" + " " * depth + "}"


def main():
    by_hand()
    files = {"codes": codes(), "strategies": strategies(), "frames": frames(), "rejected": rejected(),
             "sessions": sessions(), "eeprom": eeprom()}
    check, stale = sys.argv[1:] == ["--check"], []
    for name, vectors in files.items():
        path = os.path.join(HERE, name + ".json")
        text = text_of(vectors) + "\n"
        if check:
            with open(path, encoding="ascii") as file:
                if file.read() != text:
                    stale.append(path)
        else:
            with open(path, "w", encoding="ascii") as file:
                file.write(text)
    if stale:
        sys.exit("not what the generator writes: " + ", ".join(stale))


if __name__ == "__main__":
    main()
