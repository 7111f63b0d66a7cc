"""The table of families, the one place that names them all: a new one is a file in this folder and a row here."""

from __future__ import annotations

from functools import partial

from trocar.studies.stability.families import (
    abuse,
    drawn,
    driving,
    ducts,
    effect_pairs,
    grasping,
    jerks,
    jumps,
    loads,
    lost_ticks,
    materials,
    numbers,
    patients,
    probing,
    random_play,
    rolling,
    steps,
    sticking,
    switches,
    theory,
    tool_on_wall,
    undamped,
    vanishing,
    walls,
    wires,
)
from trocar.studies.stability.family import Family

FAMILIES: dict[str, Family] = {
    "drawn": Family("duct, catheter, friction, effects and two hands that cross, all drawn", drawn.cases),
    "patients": Family("cystic ducts with folds, drawn within published ranges, under the same hands", patients.cases),
    "jumps": Family("a tool jumps by 1 to 50 mm in one tick", jumps.cases),
    "jerks": Family("a hand jerks by 10 to 30 mm at 0.1 to 2 m/s in a random direction", jerks.cases),
    "lost_ticks": Family("as the hands move: jitter, 20 % of the ticks lost, stalls of 5 to 250 ms", lost_ticks.cases),
    "vanishing": Family("tools that vanish and come back, holding and pressing", vanishing.cases),
    "abuse": Family(
        "a catheter jammed, buckled, dragged over the rim, torn at; jaws shut on wall and catheter", abuse.cases
    ),
    "grasping": Family("jaws that open and shut 20 times a second", grasping.cases),
    "rolling": Family("jaws roll to and fro at 1 to 20 rad/s, holding, squeezing and pressing", rolling.cases),
    "probing": Family("a probe pressed into wall and catheter and dragged over both", probing.cases),
    "driving": Family("a catheter pushed, twisted and steered through a fork, by any opening", driving.cases),
    "driving_tube": Family("the same through a tube, by both ends", partial(driving.cases, wall=driving.Wall.TUBE)),
    "guide_wire": Family(
        "the same fork, with a guide wire pushed and twisted ahead", partial(driving.cases, wire=driving.WIRE)
    ),
    "guide_wire_tube": Family(
        "the same wire in the tube", partial(driving.cases, wall=driving.Wall.TUBE, wire=driving.WIRE)
    ),
    "numbers": Family(
        "NaN, infinities and what overflows, from a device and from a caller", numbers.cases, may_heal=True
    ),
    "switches": Family("the quality level switches in every tick", switches.cases),
    "effect_pairs": Family("every pair of effects", effect_pairs.cases),
    "steps": Family("steps of 0.1 to 50 ms", steps.cases),
    "stiffness": Family("catheters 0.01 to 1000 times as stiff", materials.stiffness_cases),
    "mass": Family("catheter, wall or a stone 0.01 to 100 times as heavy", materials.mass_cases),
    "wires": Family("guide wires of 60 and 200 GPa, 0.3 to 0.9 mm thick", wires.cases),
    "ducts": Family("ducts conical, curved, slit, oblique, bulging, meshed coarser and finer", ducts.cases),
    "friction": Family("friction coefficients of 1 to 2", loads.friction_cases),
    "gravity": Family("gravity in any direction, the wall's own as well", loads.gravity_cases),
    "thickness": Family("walls of 0.002 to 0.3 of the radius", walls.thickness_cases),
    "poisson": Family("Poisson's ratios to 0.4999", walls.poisson_cases),
    "slivers": Family("walls meshed with slivers of 1:10 to 1:100", walls.sliver_cases),
    "sticking": Family("seals and grips that stick, at steps of 1 to 0.1 ms", sticking.cases),
    "tool_on_wall": Family("a jaw that sticks to the wall, at ticks of 1 to 0.1 ms", tool_on_wall.cases),
    "undamped": Family("a million steps without damping", undamped.cases),
    "theory": Family("methods below and above where they must fail", theory.cases),
    "random_play": Family("an hour of random play", random_play.cases),
}
