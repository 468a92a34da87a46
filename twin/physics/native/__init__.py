"""Compiled code that runs inside MuJoCo's step; see `twin.physics.native.plant`."""
