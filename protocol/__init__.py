"""The wire contract of the rig: typed bodies, topic table, envelope, codec, upgrades. No sockets, no clock."""

from trocar.protocol.frame import PROTOCOL_VERSION, Frame, FrameError, Reason, decode, encode, peek
from trocar.protocol.topics import PROCESSES, TOPICS, Topic, topic

__all__ = [
    "PROCESSES",
    "PROTOCOL_VERSION",
    "TOPICS",
    "Frame",
    "FrameError",
    "Reason",
    "Topic",
    "decode",
    "encode",
    "peek",
    "topic",
]
