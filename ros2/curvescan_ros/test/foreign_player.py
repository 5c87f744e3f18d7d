"""Another vendor's DDS plays scans: `python foreign_player.py SCANS.npz RATE_HZ`, by Cyclone DDS, with no ROS at all."""

import os
import sys
import time
from dataclasses import dataclass

os.environ["CYCLONEDDS_URI"] = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='true'/>"
    "</Interfaces><AllowMulticast>true</AllowMulticast></General><Discovery>"
    "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>60</MaxAutoParticipantIndex>"
    "<Peers><Peer address='127.0.0.1'/></Peers></Discovery></Domain></CycloneDDS>"
)

import numpy as np
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float32, int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class Stamp(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    """builtin_interfaces/Time."""

    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    """std_msgs/Header."""

    stamp: Stamp
    frame_id: str


@dataclass
class Scan(IdlStruct, typename="sensor_msgs::msg::dds_::LaserScan_"):
    """sensor_msgs/LaserScan."""

    header: Header
    angle_min: float32
    angle_max: float32
    angle_increment: float32
    time_increment: float32
    scan_time: float32
    range_min: float32
    range_max: float32
    ranges: sequence[float32]
    intensities: sequence[float32]


def main() -> None:
    """Wait for a reader, and write the scans."""
    data, rate = np.load(sys.argv[1]), float(sys.argv[2])
    participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(200))
    writer = DataWriter(participant, Topic(participant, "rt/scan", Scan), qos=qos)
    deadline = time.monotonic() + 60.0
    while not writer.get_matched_subscriptions() and time.monotonic() < deadline:
        time.sleep(0.1)
    time.sleep(1.0)
    fields = ("angle_min", "angle_increment", "time_increment", "scan_time", "range_min", "range_max")
    numbers = {name: float(data[name]) for name in fields}
    for nanoseconds, ranges in zip(data["nanoseconds"].tolist(), data["ranges"], strict=True):
        stamp = Stamp(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        writer.write(
            Scan(
                header=Header(stamp=stamp, frame_id="laser"),
                angle_max=0.0,
                ranges=ranges.tolist(),
                intensities=[],
                **numbers,
            )
        )
        time.sleep(1.0 / rate)
    time.sleep(2.0)


if __name__ == "__main__":
    main()
