"""What `distal` is to packages in which people already work: ORCA's own software, LeRobot's
datasets and processors, PyTorch, MuJoCo.

In: their samples, in their units and order; out: joint angles with their stds, in theirs.

    from importlib.util import find_spec

    print({name: find_spec(name) is not None for name in ("lerobot", "mujoco", "torch")})
"""
