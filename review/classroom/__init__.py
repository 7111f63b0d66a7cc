"""A classroom: many rigs on one page, each as its own page tells it, and the instructor's desk that commands them."""
