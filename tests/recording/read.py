"""Reads a recording of the virtual robot with two independent readers: `mcap` with its ROS 2 decoder, and
`rosbags`.

    read.py PROGRAM ELF FOLDER
"""

import math
import subprocess
import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

EXPECTED = {
    "/pose": "geometry_msgs/msg/PoseStamped",
    "/settings": "std_msgs/msg/String",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/range/front": "sensor_msgs/msg/Range",
    "/range/right": "sensor_msgs/msg/Range",
    "/range/left": "sensor_msgs/msg/Range",
    "/battery_state": "sensor_msgs/msg/BatteryState",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/map": "nav_msgs/msg/OccupancyGrid",
}


def by_mcap(path):
    """Topic -> [(log time, message)]."""
    read = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert EXPECTED.get(channel.topic, schema.name) == schema.name, channel.topic
            read.setdefault(channel.topic, []).append((message.log_time, decoded))
    return read


def by_rosbags(path):
    """The same; the types are those that the file defines."""
    read = {}
    with AnyReader([path]) as reader:
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            read.setdefault(connection.topic, []).append((time, message))
    return read


program, elf, folder = sys.argv[1:]
(Path(folder) / "tour").write_text("300 0 0\n")
for words in [
    "eeprom init --force robot.toml",
    "eeprom write robot.toml",
    "map tour --out map --record drive.mcap",
]:
    board = ["--virtual", "--elf", elf, "--eeprom-image", "eeprom.bin"]
    subprocess.run([program, *words.split(), *board], cwd=folder, check=True, stdout=sys.stderr)
path = Path(folder) / "drive.mcap"
one, other = by_mcap(path), by_rosbags(path)
assert set(EXPECTED) <= set(one), f"missing: {set(EXPECTED) - set(one)}"
counts = {topic: len(messages) for topic, messages in one.items()}
assert counts == {topic: len(messages) for topic, messages in other.items()}, "the readers differ"
for read in (one, other):
    times = [time for time, _ in read["/pose"]]
    assert times == sorted(times) and len(times) > 40
    end = read["/pose"][-1][1].pose.position
    assert math.hypot(end.x - 0.3, end.y) < 0.01, end
    grid = read["/map"][-1][1]
    assert grid.info.width * grid.info.height == len(grid.data) > 0
    assert any(math.isfinite(one.range) and one.range > 0 for _, one in read["/range/right"])
    assert "[platform]" in read["/settings"][0][1].data
    mounts = {one.child_frame_id: one for one in read["/tf_static"][0][1].transforms}
    assert mounts["range_left"].transform.translation.y > 0 > mounts["range_right"].transform.translation.y
    assert 6 < read["/battery_state"][0][1].voltage < 8.5
print(f"{sum(counts.values())} messages on {len(counts)} topics, read alike by mcap and rosbags")
