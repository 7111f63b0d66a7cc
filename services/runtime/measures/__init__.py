"""What a loop measures of itself: histograms, durations of stages, and the flight ring."""
