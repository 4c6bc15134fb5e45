"""Steps and loops of users: own maps, compiled systems, sections of orbits."""
