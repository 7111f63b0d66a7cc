"""A classroom: many rigs on one page, each as its own page tells it. It only looks: who acts goes to a rig's page."""
