// The colour of a force's size.

export function colourOfForce(newton) {
  return newton < 1 ? "#67d1bd" : newton < 2 ? "#eab54d" : "#f0695a";
}
