"""Native code: compiled functions inside MuJoCo's step; see `twin.physics.native.plant`."""
