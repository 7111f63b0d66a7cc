"""A recording in Rerun, without Trocar: duct, catheter and tools as they moved, forces and depth below.

pip install rerun-sdk mcap-protobuf-support
python rerun_scene.py recording.mcap            # opens the viewer, with rerun-blueprint.rbl
python rerun_scene.py recording.mcap scene.rrd  # writes a file that the viewer opens
"""

import sys
from pathlib import Path

import numpy as np
import rerun as rr
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

rr.init("trocar", spawn=len(sys.argv) < 3)
if len(sys.argv) > 2:
    rr.save(sys.argv[2])
rr.log_file_from_path(Path(__file__).with_name("rerun-blueprint.rbl"))
with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, decoder_factories=[DecoderFactory()])
    for _, channel, message, body in reader.iter_decoded_messages(["/scene", "/physics/state"]):
        rr.set_time("time", timestamp=1e-9 * message.log_time)
        if channel.topic == "/physics/state":
            rr.log("depth_mm", rr.Scalars(1e3 * body.catheter.inserted_length_m))
            for number, tool in enumerate(body.tools):
                rr.log(f"force_n/{number}", rr.Scalars(float(np.linalg.norm(tool.force_n))))
            continue
        for entity in body.entities:
            for number, part in enumerate([*entity.triangles, *entity.lines]):
                points = np.array([(each.x, each.y, each.z) for each in part.points])
                colour = [round(255 * getattr(part.color, name)) for name in "rgba"]
                place = ["scene", entity.id, str(number)]
                if hasattr(part, "thickness"):
                    strips = points.reshape(-1, 2, 3) if part.type == part.LINE_LIST else [points]
                    rr.log(place, rr.LineStrips3D(strips, colors=colour, radii=0.5 * part.thickness))
                else:
                    corners = np.reshape(part.indices, (-1, 3))
                    rr.log(place, rr.Mesh3D(vertex_positions=points, triangle_indices=corners, albedo_factor=colour))
