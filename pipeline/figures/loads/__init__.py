"""How a reducer carries a torque: its contacts, its loop, its turn."""
