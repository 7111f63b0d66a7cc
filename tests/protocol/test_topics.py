"""The topic table agrees with itself and with what sockets need."""

from __future__ import annotations

import pytest

from trocar.protocol import PROCESSES, TOPICS, topic
from trocar.protocol.fields import fields, nested
from trocar.protocol.topics import published_by, read_by
from trocar.services.runtime.bus.endpoints import endpoint
from trocar.services.runtime.config.rig import Transport


def test_names_say_who_publishes() -> None:
    for name, row in TOPICS.items():
        assert name.split(".")[0] == row.publisher
        assert {row.publisher, *row.readers, *row.observers} <= set(PROCESSES)
        assert len({row.publisher, *row.readers, *row.observers}) == 1 + len(row.readers) + len(row.observers)


def test_every_process_is_heard_and_hears() -> None:
    for process in PROCESSES:
        assert f"{process}.health" in published_by(process)
        assert read_by(process)


def test_endpoints_differ_and_come_from_the_name_alone() -> None:
    tcp = Transport(kind="tcp")
    ports = {endpoint(tcp, name) for name in TOPICS}
    assert len(ports) == len(TOPICS)
    assert endpoint(tcp, "gateway.state") == "tcp://127.0.0.1:24783"


def test_every_field_travels() -> None:
    for row in TOPICS.values():
        for body in (row.body, *nested(row.body)):
            assert fields(body)


def test_an_unknown_topic_names_the_known() -> None:
    with pytest.raises(KeyError, match=r"no topic 'gateway.coffee'; known: gateway.state"):
        topic("gateway.coffee")
