"""Reads and drives the virtual robot by CycloneDDS, a DDS that shares no code with the program's.

    bridge.py PROGRAM ELF FOLDER

`robot serve` and `robot ros2` run as processes of their own and speak on this computer only. A second driver
is another DDS participant, and another client of the server.
"""

import json
import math
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

DOMAIN = 77
NAMESPACE = "kitchen"
# Unicast on the loopback interface: multicast is off there on Linux.
os.environ["CYCLONEDDS_URI"] = """<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo"
multicast="false"/></Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery>
<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>9</MaxAutoParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>"""

import messages as ros
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

RELIABLE = Policy.Reliability.Reliable(duration(seconds=1))
LATEST = Policy.History.KeepLast(50)
VOLATILE = Qos(RELIABLE, Policy.Durability.Volatile, LATEST)
LATCHED = Qos(RELIABLE, Policy.Durability.TransientLocal, LATEST)
# The lease of a velocity, the stop deadline, and what a loaded computer takes besides, seconds.
STOPPED_S = 0.5 + 0.25 + 1.0


class Participant:
    """A DDS participant with the robot's topics."""

    def __init__(self):
        self.participant = DomainParticipant(DOMAIN)

    def topic(self, name, kind):
        return Topic(self.participant, f"rt/{NAMESPACE}/{name}", kind)

    def reader(self, name, kind, qos=VOLATILE):
        return DataReader(self.participant, self.topic(name, kind), qos=qos)

    def writer(self, name, kind):
        return DataWriter(self.participant, self.topic(name, kind), qos=VOLATILE)


class Driver(threading.Thread):
    """Publishes a velocity at 20 Hz until it is silenced."""

    def __init__(self, participant, twist):
        super().__init__(daemon=True)
        self.writer, self.twist, self.silent = participant.writer("cmd_vel", ros.Twist), twist, False
        self.longest_pause = 0
        self.start()

    def run(self):
        last = time.monotonic()
        while not self.silent:
            self.writer.write(self.twist)
            time.sleep(0.05)
            now = time.monotonic()
            self.longest_pause, last = max(self.longest_pause, now - last), now

    def silence(self):
        self.silent = True
        self.join()
        return time.monotonic()


class Client:
    """A client of `robot serve` by its own protocol."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.connect(str(path))
        self.lines = self.socket.makefile()
        self.ask(do="hello", version=1, name="other client")

    def ask(self, **request):
        """The messages up to the reply, which is last."""
        self.socket.sendall(json.dumps(request).encode() + b"\n")
        read = [json.loads(self.lines.readline())]
        while read[-1]["type"] != "reply":
            read.append(json.loads(self.lines.readline()))
        return read

    def frame(self):
        return next(read for read in self.ask(do="status") if read["type"] == "frame")


def twist(forward=0.0, yaw=0.0, **linear):
    return ros.Twist(ros.Vector3(x=forward, **linear), ros.Vector3(z=yaw))


def goal(frame, x, y):
    position = ros.Point(x=float(x), y=float(y))
    return ros.PoseStamped(ros.Header(frame_id=frame), ros.Pose(position))


def awaited(what, found, seconds=20):
    """What `found` returns once that is true."""
    ends = time.monotonic() + seconds
    while time.monotonic() < ends:
        result = found()
        if result:
            return result
        time.sleep(0.01)
    raise AssertionError(f"{what}: not within {seconds} s")


def turn(orientation):
    return 2 * math.atan2(orientation.z, orientation.w)


def composed(outer, inner):
    """x, y and angle of a pose given in another."""
    (x, y, angle), (dx, dy, turned) = outer, inner
    sine, cosine = math.sin(angle), math.cos(angle)
    return x + dx * cosine - dy * sine, y + dx * sine + dy * cosine, angle + turned


class Robot:
    """The latest of what the node publishes."""

    def __init__(self, participant, log):
        self.log = log
        self.readers = {
            name: participant.reader(name, kind)
            for name, kind in {
                "odom": ros.Odometry,
                "tf": ros.TFMessage,
                "range_front": ros.Range,
                "range_right": ros.Range,
                "range_left": ros.Range,
                "battery_state": ros.BatteryState,
                "diagnostics": ros.DiagnosticArray,
            }.items()
        }
        self.latest, self.counts = {}, dict.fromkeys(self.readers, 0)

    def read(self):
        for name, reader in self.readers.items():
            for sample in reader.take(50):
                self.latest[name] = sample
                self.counts[name] += 1
        return self.latest

    def odom(self):
        """x, forward velocity and yaw rate of a report that comes from now on."""
        before = self.counts["odom"]
        awaited("/odom", lambda: self.read() and self.counts["odom"] > before)
        odom = self.latest["odom"]
        velocity = odom.twist.twist
        return odom.pose.pose.position.x, velocity.linear.x, velocity.angular.z

    def forward(self):
        return self.odom()[1]

    def stopped_after(self, since):
        """Seconds until it stands still for ten reports."""
        still = 0
        while still < 10:
            _, forward, yaw = self.odom()
            if still == 0:
                first = time.monotonic()
            still = still + 1 if abs(forward) < 0.002 and abs(yaw) < 0.02 else 0
            assert time.monotonic() < since + 20, "it does not stop"
        return first - since

    def warned(self, *words):
        """Waits for a warning of the node with these words."""
        log = lambda: any(all(word in line for word in words) for line in self.log.read_text().splitlines())
        awaited(f"a warning of {words}", log)


def check_refusals(robot, participant):
    """Wrong commands move nothing and are named, once a second."""
    start, begun = robot.odom()[0], time.monotonic()
    for wrong, field in [
        (twist(math.nan), "linear.x = NaN"),
        (twist(0.1, y=0.1), "linear.y = 0.1"),
        (twist(7.0), "linear.x = 7"),
        (twist(0.1, math.inf), "angular.z = inf"),
    ]:
        driver = Driver(participant, wrong)
        robot.warned("/cmd_vel", field)
        driver.silence()
        time.sleep(1.0)
    warnings = robot.log.read_text().count("/cmd_vel: ")
    assert warnings <= time.monotonic() - begun + 1, f"{warnings} warnings"
    writer = participant.writer("goal_pose", ros.PoseStamped)
    for wrong, field in [
        (goal("base_link", 1, 0), 'header.frame_id = "base_link"'),
        (goal("map", math.nan, 0), "pose.position.x = NaN"),
    ]:
        awaited("the node's subscription", lambda: writer.get_matched_subscriptions())
        writer.write(wrong)
        robot.warned("/goal_pose", field)
        time.sleep(1.0)
    assert abs(robot.odom()[0] - start) < 0.002, "it moved"


def check_drive(robot, participant, client):
    """The first publisher drives; others are refused; silence stops. Seconds until it stops."""
    driver = Driver(participant, twist(0.1))
    awaited("motion", lambda: abs(robot.forward() - 0.1) < 0.03)
    refused = client.ask(do="drive", forward_mm_s=-100, yaw_rate_deg_s=0)[-1]["error"]
    assert "drives the robot" in refused["text"], refused
    for _ in range(3):
        driver.longest_pause = 0
        other = Driver(Participant(), twist(-0.1))
        robot.warned("/cmd_vel", "another publisher drives")
        speeds = [robot.forward() for _ in range(40)]
        other.silence()
        # On a busy computer the first one may itself pause for longer than its lease, and the second drives.
        if driver.longest_pause < 0.25:
            break
        awaited("motion", lambda: abs(robot.forward() - 0.1) < 0.03)
    assert min(speeds) > 0.03, f"the second publisher drives: {min(speeds)} m/s"
    return robot.stopped_after(driver.silence())


def check_other_driver(robot, participant, client):
    """The node is refused while another client of the server drives."""
    begun = robot.odom()[0]
    client.ask(do="drive", forward_mm_s=-60, yaw_rate_deg_s=0, lease_ms=3000)
    driver = Driver(participant, twist(0.1))
    robot.warned("/cmd_vel", "other client drives the robot")
    assert robot.odom()[0] < begun + 0.002
    driver.silence()
    client.ask(do="stop")
    robot.stopped_after(time.monotonic())


def check_stop(robot, participant):
    """/estop stops a robot that goes on being commanded, until it is released. Seconds until it stops."""
    estop = participant.writer("estop", ros.Bool)
    driver = Driver(participant, twist(0.0, 0.8))
    awaited("motion", lambda: robot.odom()[2] > 0.4)
    awaited("the node's subscription", lambda: estop.get_matched_subscriptions())
    estop.write(ros.Bool(True))
    seconds = robot.stopped_after(time.monotonic())
    robot.warned("/cmd_vel", "/estop is set")
    assert abs(robot.odom()[2]) < 0.02
    estop.write(ros.Bool(False))
    awaited("motion", lambda: robot.odom()[2] > 0.4)
    robot.stopped_after(driver.silence())
    return seconds


def check_goal(robot, participant, client):
    """The robot plans its way to a point of the map. How far from it it ends, mm."""
    writer = participant.writer("goal_pose", ros.PoseStamped)
    awaited("the node's subscription", lambda: writer.get_matched_subscriptions())
    estimate = client.frame()["estimate"]
    x, y = estimate["x_mm"] - 250, estimate["y_mm"]
    writer.write(goal("map", x / 1000, y / 1000))
    awaited("the way", lambda: client.frame()["activity"] == "goto")
    awaited("the goal", lambda: client.frame()["activity"] == "idle", 60)
    estimate = client.frame()["estimate"]
    off_mm = math.hypot(estimate["x_mm"] - x, estimate["y_mm"] - y)
    assert off_mm < 125, f"{off_mm} mm from the goal"
    return off_mm


def check_reports(robot, participant, client):
    """The published messages carry the values of the server."""
    awaited("all topics", lambda: robot.read() and all(robot.counts.values()))
    robot.stopped_after(time.monotonic())
    read, frame = robot.latest, client.frame()
    frames = {one.child_frame_id: one for one in read["tf"].transforms}
    plane = lambda one: (one.transform.translation.x, one.transform.translation.y, turn(one.transform.rotation))
    x, y, angle = composed(plane(frames["odom"]), plane(frames["base_link"]))
    assert frames["odom"].header.frame_id == "map" and frames["base_link"].header.frame_id == "odom"
    estimate = frame["estimate"]
    assert math.hypot(x * 1000 - estimate["x_mm"], y * 1000 - estimate["y_mm"]) < 5, (x, y, estimate)
    assert abs(math.remainder(angle - math.radians(estimate["rotation_deg"]), math.tau)) < 0.02
    assert abs(plane(frames["range_right"])[2] + math.pi / 2) < 0.01
    robot_mm = frame["robot"]["ranges_mm"]
    for name, mm in zip(("range_front", "range_right", "range_left"), robot_mm):
        measured = read[name]
        assert measured.header.frame_id == name and measured.max_range == 2.5 and abs(measured.min_range - 0.02) < 1e-6
        assert abs(measured.field_of_view - 0.26) < 0.01, measured.field_of_view
        assert name == "range_front" or mm is None or abs(measured.range * 1000 - mm) < 40, (name, measured.range, mm)
    battery = read["battery_state"]
    assert 6 < battery.voltage < 8.5 and len(battery.cell_voltage) == 2
    status = read["diagnostics"].status[0]
    assert status.hardware_id == "stm32f411" and {"mode", "frames"} <= {one.key for one in status.values}
    assert abs(time.time() - read["odom"].header.stamp.sec) < 5
    assert read["odom"].child_frame_id == "base_link"
    # A subscriber that comes late gets the map.
    late = Participant().reader("map", ros.OccupancyGrid, LATCHED)
    grid = awaited("/map", lambda: late.take(1))[0]
    assert grid.header.frame_id == "map" and grid.info.width * grid.info.height == len(grid.data)
    assert {0, 100} <= set(grid.data) <= {-1, 0, 100} and abs(grid.info.resolution - 0.025) < 1e-6


def main(program, elf, folder):
    folder = Path(folder)
    image = folder / "eeprom.bin"
    os.environ["ROBOT_ELF"] = elf
    virtual = ["--virtual", "--eeprom-image", str(image)]
    started = []

    def start(log, *words):
        with log.open("w") as file:
            started.append(subprocess.Popen([program, *words, *virtual], stdout=file, stderr=file))
        return started[-1]

    node = ["ros2", "--localhost", "--domain", str(DOMAIN), "--namespace", NAMESPACE]
    try:
        path = image.with_name("eeprom.bin.sock")
        for left in (image, path):
            left.unlink(missing_ok=True)
        server = start(folder / "serve.log", "serve")
        awaited("the server", lambda: server.poll() is None and path.exists(), 60)
        log = folder / "ros2.log"
        bridge = start(log, *node)
        participant, client = Participant(), Client(path)
        robot = Robot(participant, log)
        robot.odom()
        check_refusals(robot, participant)
        silent_s = check_drive(robot, participant, client)
        check_other_driver(robot, participant, client)
        stop_s = check_stop(robot, participant)
        off_mm = check_goal(robot, participant, client)
        check_reports(robot, participant, client)
        assert silent_s < STOPPED_S and stop_s < STOPPED_S, (silent_s, stop_s)
        # What changes slowly comes once a second.
        assert robot.counts["battery_state"] < robot.counts["odom"] / 10, robot.counts
        counts = sum(robot.counts.values())
        bridge.send_signal(signal.SIGTERM)
        bridge.wait(10)
        server.send_signal(signal.SIGTERM)
        server.wait(10)
        # Without a server the node opens the robot itself, and changes its mode where it may.
        mode = [program, "mode", "guarded-normal", *virtual]
        subprocess.run(mode, check=True, capture_output=True)
        alone = start(log, *node, "--yes")
        robot.odom()
        driver = Driver(participant, twist(0.1))
        awaited("motion in the changed mode", lambda: abs(robot.forward() - 0.1) < 0.03)
        driver.silence()
        alone.send_signal(signal.SIGTERM)
        alone.wait(10)
        print(
            f"{counts} messages read by CycloneDDS; stops {silent_s:.2f} s after the last velocity, "
            f"{stop_s:.2f} s after /estop; {off_mm:.0f} mm from its goal"
        )
    finally:
        for process in started:
            process.kill()


main(*sys.argv[1:])
