"""Pictures are made of the newest frames: the duct as modes and loads say, the tools where the tissue lets them."""

from collections.abc import Iterable

import msgspec
import numpy as np
import pytest

from tests.memory_bus import MemoryBus, MemoryHub
from tests.visualization.small_duct import MODES, make_duct
from trocar.protocol import bodies
from trocar.protocol.arrays import pack
from trocar.protocol.bodies.physics import reaction_table
from trocar.services.mechanics.effects.gallstones import GallstonesSettings
from trocar.services.mechanics.scene import CatheterScene, ForcepsScene, GuideWireScene, ProbeScene, SceneModel
from trocar.services.visualization.composer import TOPICS, Composer

DUCT = make_duct()
HASH = DUCT.basis.content_hash


def duct_of(q: Iterable[float], nodes: Iterable[int] = (), forces: object = (), of: str = HASH) -> bodies.Duct:
    q, force = list(q), np.reshape(np.asarray(forces, float), (-1, 3))
    loads = {"load_node": pack(list(nodes), "<i4"), "load_force_n": pack(force)}
    return bodies.Duct(basis_hash=of, q=pack(q), q_rate=pack(q), **loads)


class Rig:
    """A composer, and a hand on every publisher that it reads."""

    def __init__(self, scene: SceneModel | None = None) -> None:
        hub = MemoryHub()
        self.out = MemoryBus(hub, publishes=TOPICS)
        scene = scene or SceneModel()
        self.composer = Composer(MemoryBus(hub, reads=TOPICS), scene, "test", DUCT)
        none = pack(np.zeros((0, 3)))
        catheter = bodies.Catheter(position_m=none, velocity_m_s=none, radius_m=0.5 * scene.catheter.outer_diameter_m)
        contacts = bodies.ContactForces(kind=pack([], "|i1"), point_m=none, force_n=none)
        self.state = bodies.PhysicsState(
            tick=0, tools=reaction_table(()), duct=duct_of([0.0]), catheter=catheter, contacts=contacts
        )

    def say(self, t: int = 1, **changes: object) -> None:
        """Physics says what it said, with `changes`."""
        self.state = msgspec.structs.replace(self.state, tick=t, **changes)
        self.out.publish("physics.state", self.state, origin_ns=t)

    def bend(self, q: Iterable[float], nodes: Iterable[int] = (), forces: object = (), *, of: str = HASH, t: int = 1):
        self.say(t, duct=duct_of(q, nodes, forces, of))

    def hold(self, *instruments: bodies.InstrumentState, tick: int = 1) -> None:
        self.out.publish("gateway.state", bodies.GatewayState(tick=tick, instruments=instruments), origin_ns=tick)

    def react(self, *tools: bodies.ToolReaction) -> None:
        self.say(tools=reaction_table(tools))


def test_before_anything_arrives_the_duct_is_at_rest():
    picture = Rig().composer.compose()
    np.testing.assert_array_equal(picture.points_m, DUCT.mesh.vertices_m.astype(np.float32))
    assert (len(picture.poses), len(picture.centreline_m), picture.origin_ns) == (0, 0, 0)


def test_the_surface_is_rest_plus_modes_plus_residual():
    rig = Rig()
    q = np.linspace(-1e-3, 1e-3, MODES)
    nodes, forces = [3, 20], np.array([[0.1, -0.2, 0.3], [0.0, 0.5, -0.1]])
    rig.bend(q, nodes, forces)
    blocks = DUCT.residual.blocks.reshape(35, 35, 3, 3)
    expected = DUCT.mesh.vertices_m + np.einsum("nkr,r->nk", DUCT.basis.Phi, q)
    expected += np.einsum("nlij,lj->ni", blocks[:, nodes], forces)
    np.testing.assert_allclose(rig.composer.compose().points_m, expected, rtol=1e-5, atol=1e-8)


def test_stones_are_where_the_scene_puts_them_until_physics_says_where_they_are():
    places_m = ((20e-3, 0.0, 0.0), (10e-3, 1e-3, 0.0))
    rig = Rig(SceneModel(effects={"gallstones": GallstonesSettings(places_m, (1e-3, 2e-3))}))
    np.testing.assert_allclose(rig.composer.compose().stones_m, places_m, rtol=1e-6)
    assert rig.composer.layout.stone_radii_m == (1e-3, 2e-3)
    moved_m = np.array(places_m) + 3e-3
    rig.say(stones_m=pack(moved_m))
    np.testing.assert_allclose(rig.composer.compose().stones_m, moved_m, rtol=1e-6)
    rig.say(2, stones_m=pack(moved_m[:1]))  # of a physics that runs another scene
    np.testing.assert_allclose(rig.composer.compose().stones_m, moved_m, rtol=1e-6)


def test_a_lower_quality_level_sends_fewer_modes():
    rig = Rig()
    rig.bend([1e-3, -2e-3])
    expected = DUCT.mesh.vertices_m + DUCT.basis.Phi[:, :, :2] @ [1e-3, -2e-3]
    np.testing.assert_allclose(rig.composer.compose().points_m, expected, rtol=1e-5)


@pytest.mark.parametrize(
    ("q", "nodes", "of"),
    [([0.1] * MODES, [35], HASH), ([0.1] * MODES, [-1], HASH), ([0.1] * (MODES + 1), [], HASH), ([0.1], [], "other")],
    ids=["node beyond the mesh", "negative node", "too many modes", "another basis"],
)
def test_a_frame_that_does_not_fit_the_duct_is_refused_and_the_picture_stays(q, nodes, of):
    rig = Rig()
    rig.bend([1e-3] * MODES)
    good = rig.composer.compose().points_m.copy()
    rig.bend(q, nodes, np.ones((len(nodes), 3)), of=of, t=2)
    np.testing.assert_array_equal(rig.composer.compose().points_m, good)
    assert rig.composer.refused == 1


def test_only_a_new_device_sample_has_an_age():
    rig = Rig()
    rig.bend([0.0], t=7)
    assert [rig.composer.compose().origin_ns for _ in range(3)] == [7, 0, 0]
    rig.bend([0.0], t=8)
    assert rig.composer.compose().origin_ns == 8


def test_without_physics_the_device_itself_gives_the_age():
    rig = Rig()
    rig.hold(bodies.InstrumentState(name="left", position_m=(0.0, 0.0, 0.0)), tick=5)
    assert rig.composer.compose().origin_ns == 5


def test_the_layout_changes_with_tools_and_particles_and_with_nothing_else():
    rig = Rig()
    rig.composer.compose()
    first = rig.composer.layout
    left = bodies.InstrumentState(name="left", position_m=(0.0, 0.0, 0.0), port_m=(0.0, 0.0, 0.1))
    rig.hold(left)
    assert rig.composer.compose().epoch == first.epoch + 1
    rig.hold(left, tick=2)
    rig.bend([1e-3])
    assert rig.composer.compose().epoch == first.epoch + 1
    line = np.zeros((4, 3))
    rig.say(catheter=bodies.Catheter(position_m=pack(line), velocity_m_s=pack(line), radius_m=1e-3))
    assert rig.composer.compose().epoch == first.epoch + 2
    assert rig.composer.layout.n_particles == 4


def test_a_guide_wire_is_as_thick_as_the_scene_says_and_begins_at_the_catheters_tip():
    wire = GuideWireScene(outer_diameter_m=0.6e-3, reach_m=20e-3)
    rig = Rig(SceneModel(catheter=CatheterScene(n_segments=50, length_m=0.1, guide_wire=wire)))
    line = np.zeros((61, 3))
    rig.say(catheter=bodies.Catheter(position_m=pack(line), velocity_m_s=pack(line), radius_m=1e-3))
    rig.composer.compose()
    assert [(range(61)[part], radius_m) for part, radius_m in rig.composer.layout.rods()] == [
        (range(51), 1e-3), (range(50, 61), 0.3e-3),
    ]  # fmt: skip


def test_the_catheter_is_where_physics_says_and_as_far_in():
    rig = Rig()
    line = np.linspace([0.06, 0.0, 0.0], [0.03, 0.01, 0.0], 5)
    rig.say(
        catheter=bodies.Catheter(
            position_m=pack(line), velocity_m_s=pack(0.0 * line), radius_m=1e-3, inserted_length_m=0.012
        )
    )
    picture = rig.composer.compose()
    np.testing.assert_array_equal(picture.centreline_m, line.astype(np.float32))
    assert picture.inserted_length_m == 0.012


def test_a_tool_in_free_space_is_where_the_hand_is_and_a_touching_one_where_its_proxy_is():
    rig = Rig()
    hand, proxy = (0.01, 0.02, 0.03), (0.011, 0.02, 0.035)
    rig.hold(bodies.InstrumentState(name="left", position_m=hand, port_m=(0.0, 0.0, 0.1)))
    rig.react(bodies.ToolReaction(proxy_position_m=proxy, contacts=0))
    np.testing.assert_allclose(rig.composer.compose().poses[0, :3], hand, rtol=1e-6)
    rig.react(bodies.ToolReaction(proxy_position_m=proxy, contacts=2, force_n=(1.0, 2.0, 3.0)))
    picture = rig.composer.compose()
    np.testing.assert_allclose(picture.poses[0, :3], proxy, rtol=1e-6)
    np.testing.assert_array_equal(picture.force_n[0], [1.0, 2.0, 3.0])


def test_of_a_table_of_thousands_of_tools_those_are_read_that_there_are(monkeypatch):
    """A frame has room for 4,800 of them: read all, they took as long as four pictures."""
    rig, read = Rig(), []
    from_row = bodies.ToolReaction.from_row
    monkeypatch.setattr(bodies.ToolReaction, "from_row", lambda row: read.append(row) or from_row(row))
    rig.hold(bodies.InstrumentState(name="left", position_m=(0.0, 0.0, 0.0)))
    rig.react(*[bodies.ToolReaction(force_n=(1.0, 2.0, 3.0))] * 4000)
    np.testing.assert_array_equal(rig.composer.compose().force_n, [[1.0, 2.0, 3.0]])
    assert len(read) == 1


def test_jaws_open_as_the_handle_asks_until_something_is_between_them():
    rig = Rig()
    forceps = SceneModel().forceps[0]
    wide = forceps.jaw_max_angle_rad + 1.0
    rig.hold(bodies.InstrumentState(name="left", position_m=(0.0, 0.0, 0.0), handle_angle_rad=wide))
    assert rig.composer.compose().jaw_rad[0] == pytest.approx(forceps.jaw_max_angle_rad)
    rig.react(bodies.ToolReaction(proxy_jaw_angle_rad=0.2))
    assert rig.composer.compose().jaw_rad[0] == pytest.approx(0.2)


def test_a_tool_without_jaws_is_drawn_without():
    rig = Rig(SceneModel(forceps=(ForcepsScene(), ProbeScene(tip_radius_m=2e-3))))
    port_m = (0.0, 0.0, 0.1)
    rig.hold(
        *(
            bodies.InstrumentState(name=name, position_m=(0.0, 0.0, 0.02), port_m=port_m, handle_angle_rad=0.4)
            for name in "ab"
        )
    )
    picture = rig.composer.compose()
    forceps, probe = rig.composer.layout.tools
    assert forceps.has_jaws
    assert not probe.has_jaws
    assert picture.jaw_rad == pytest.approx([0.4, 0.0])
    assert max(radius for _, radius in probe.parts[-1].profile) == pytest.approx(2e-3)
    assert probe.parts[-1].profile[-1] == pytest.approx((2e-3, 0.0))
