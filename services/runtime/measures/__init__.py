"""A loop's measurements of itself: histograms, durations of stages, and the flight ring."""
