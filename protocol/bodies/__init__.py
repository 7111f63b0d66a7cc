"""Every body that travels, one module per publisher."""

from trocar.protocol.bodies.gateway import GatewayState, InstrumentState
from trocar.protocol.bodies.haptics import ContactModel, HeldPoint, LocalModel, ToolContacts, ToolState
from trocar.protocol.bodies.health import (
    Health,
    Histogram,
    LoopReport,
    PathLatency,
    RealtimeFact,
    StageCost,
    Stall,
    TopicReport,
)
from trocar.protocol.bodies.journal import Journal
from trocar.protocol.bodies.physics import Catheter, ContactForces, Duct, PhysicsState, ToolReaction
from trocar.protocol.bodies.supervisor import (
    Event,
    Judgement,
    Order,
    ProcessReport,
    QualityReport,
    ReplayReport,
    StartReport,
    SupervisorState,
)
from trocar.protocol.bodies.training import Answer, Attempt
from trocar.protocol.bodies.visualization import Hands, HandTarget

__all__ = [
    "Answer",
    "Attempt",
    "Catheter",
    "ContactForces",
    "ContactModel",
    "Duct",
    "Event",
    "GatewayState",
    "HandTarget",
    "Hands",
    "Health",
    "HeldPoint",
    "Histogram",
    "InstrumentState",
    "Journal",
    "Judgement",
    "LocalModel",
    "LoopReport",
    "Order",
    "PathLatency",
    "PhysicsState",
    "ProcessReport",
    "QualityReport",
    "RealtimeFact",
    "ReplayReport",
    "StageCost",
    "Stall",
    "StartReport",
    "SupervisorState",
    "ToolContacts",
    "ToolReaction",
    "ToolState",
    "TopicReport",
]
