"""Compiled code that runs inside MuJoCo's step; see `twin.native.plant`."""
