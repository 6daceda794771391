"""Models in MuJoCo's language for tests: a small finger, and any of our chains."""

from __future__ import annotations

from distal import Rig

FINGER = """
<mujoco model="small finger">
  <compiler angle="radian"/>
  <worldbody>
    <body name="palm" pos="0.1 0.2 0.3" quat="0.8 0.2 0.5 0.1">
      <geom size="0.01"/>
      <site name="a" pos="-0.02 0 0.01"/>
      <body name="proximal" pos="0.01 0 0">
        <inertial pos="0.02 0 0.001" mass="0.015" diaginertia="1e-6 2e-6 3e-6"/>
        <joint name="mcp" axis="0 1 0" range="-0.3 1.5" armature="2e-6" damping="1e-3" frictionloss="2e-3"/>
        <geom name="knuckle" type="cylinder" size="0.006 0.01" quat="0.7071 0.7071 0 0"
              contype="0" conaffinity="0" mass="0"/>
        <site name="side" pos="0 0 0.02"/>
        <site name="b" pos="0.02 0 0.008"/>
        <body name="middle" pos="0.045 0 0">
          <inertial pos="0.012 0 0" mass="0.008" diaginertia="1e-7 4e-7 4e-7"/>
          <joint name="pip" axis="0 1 0" range="0 1.6" armature="1e-6" stiffness="0.05" springref="-0.2"/>
          <site name="c" pos="0.01 0 0.006"/>
          <site name="d" pos="0.01 0 -0.005"/>
          <body name="distal" pos="0.025 0 0">
            <inertial pos="0.01 0 0" mass="0.005" diaginertia="1e-7 1e-7 1e-7"/>
            <joint name="dip" axis="0 1 0" range="-0.1 1.2" armature="1e-6"/>
          </body>
        </body>
      </body>
      <body name="other" pos="0 0.05 0">
        <inertial pos="0.01 0 0" mass="0.01" diaginertia="1e-6 1e-6 1e-6"/>
        <joint name="thumb" axis="1 0 0" range="-1 1"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="extensor">
      <site site="a"/>
      <geom geom="knuckle" sidesite="side"/>
      <site site="b"/>
      <site site="c"/>
    </spatial>
    <fixed name="flexor"><joint joint="mcp" coef="-0.008"/><joint joint="pip" coef="-0.006"/></fixed>
    <spatial name="band" stiffness="300" springlength="0.02"><site site="b"/><site site="d"/></spatial>
  </tendon>
  <equality><joint joint1="pip" joint2="dip" polycoef="0 1.25 0 0 0"/></equality>
  <actuator>
    <position name="pull extensor" tendon="extensor" kp="100"/>
    <motor name="pull flexor" tendon="flexor" gear="-1"/>
    <motor name="turn thumb" joint="thumb"/>
  </actuator>
</mujoco>
"""


def written_as_mjcf(rig: Rig) -> str:
    """Return a chain as a model: links, armature, damping, friction, springs, stops, and each
    tendon as a fixed one.
    """
    inside: dict[str | None, list[str]] = {}
    for i, joint in reversed(list(enumerate(rig.joints))):
        parent = rig.parent_of(i)
        above = None if parent is None else rig.joints[parent].name
        lines = [f'<body name="{joint.name}" pos="{_list(joint.offset)}">']
        spring = joint.spring
        pulled = (
            ""
            if spring is None
            else (
                f' stiffness="{spring.stiffness.value!r}" springref="{spring.rest_angle.value!r}"'
            )
        )
        friction = joint.friction
        rubs = (
            0.0
            if friction is None
            else friction.coefficient.value * friction.radius.value * friction.preload.value
        )
        lines.append(
            f'<joint name="{joint.name}" axis="{_list(joint.axis)}" '
            f'armature="{joint.inertia.value!r}" '
            f'damping="{joint.damping.value!r}" frictionloss="{rubs!r}"{pulled}'
            + (f' range="{_list(joint.stops)}"/>' if joint.stops is not None else "/>")
        )
        if joint.link is not None:
            lines.append(
                f'<inertial pos="{_list(joint.link.centre)}" mass="{joint.link.mass.value!r}" '
                f'diaginertia="{_list(max(moment, 1e-12) for moment in joint.link.inertia)}"/>'
            )
        inside.setdefault(above, []).insert(
            0, "\n".join([*lines, *inside.get(joint.name, []), "</body>"])
        )
    tendons, motors = [], []
    for tendon in rig.tendons:
        parts = "".join(
            f'<joint joint="{name}" coef="{-arm!r}"/>' for name, arm in tendon.arms().items()
        )
        tendons.append(f'<fixed name="{tendon.name}">{parts}</fixed>')
        motors.append(f'<motor tendon="{tendon.name}" gear="-1"/>')
    gravity = _list(rig.base.gravity)
    return "\n".join(
        [
            f'<mujoco model="{rig.name}"><compiler angle="radian" boundmass="0" '
            'balanceinertia="true"/>',
            f'<option gravity="{gravity}"/><worldbody>',
            *inside[None],
            "</worldbody><tendon>",
            *tendons,
            "</tendon><actuator>",
            *motors,
            "</actuator></mujoco>",
        ]
    )


def _list(values: object) -> str:
    return " ".join(repr(float(value)) for value in values)  # type: ignore[attr-defined]
