"""Process: bus to MCAP file with protobuf payloads, which Foxglove, Rerun and PlotJuggler open."""
