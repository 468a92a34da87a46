"""A vehicle that is no glider: the torpedo of `vehicles/torpedo.xml`, and one of geometry alone."""

from pathlib import Path

TORPEDO = Path(__file__).parent / "vehicles" / "torpedo.xml"
SHIPPED = ("glider", "graver-2005", "rogue")

GEOMETRY_ONLY = """
<mujoco model="geometry-only">
  <compiler angle="radian" autolimits="true" inertiafromgeom="false"/>
  <option timestep="0.005" integrator="discrete" gravity="0 0 -9.81" density="0" viscosity="0">
    <flag contact="disable" constraint="disable" autoreset="disable"/>
  </option>
  <custom>
    <numeric name="reference_density" data="1025"/>
    <numeric name="hull_length" data="1.6"/>
    <numeric name="hull_diameter" data="0.19"/>
    <numeric name="hull_compressibility" data="0"/>
    <text name="hull_law" data="ellipsoid"/>
    <text name="propeller.kind" data="propeller"/>
    <numeric name="propeller.diameter" data="0.14"/>
    <numeric name="propeller.thrust_coefficient" data="0.0045"/>
    <text name="rudder.kind" data="fin"/>
    <numeric name="rudder.axis" data="0 0 1"/>
    <numeric name="rudder.area" data="0.03"/>
    <numeric name="rudder.lift_slope" data="3.1"/>
    <text name="elevator.kind" data="fin"/>
    <numeric name="elevator.axis" data="0 1 0"/>
    <numeric name="elevator.area" data="0.03"/>
    <numeric name="elevator.lift_slope" data="3.1"/>
    <numeric name="pitch_pid" data="1.2 0.1 0.6"/>
    <numeric name="heading_pid" data="0.8 0.02 0.8"/>
    <numeric name="control_period" data="0.2"/>
    <numeric name="cruise_speed" data="1.2"/>
  </custom>
  <worldbody>
    <body name="hull">
      <freejoint name="hull"/>
      <inertial pos="0 0 -0.02" mass="30" diaginertia="0.18 3.45 3.45"/>
      <geom type="ellipsoid" size="0.8 0.095 0.095" mass="0" fluidshape="ellipsoid"
        fluidcoef="0.2 0.1 1.5 1 1" contype="0" conaffinity="0"/>
      <site name="cb"/> <site name="imu"/> <site name="gps"/>
      <site name="propeller" pos="-0.8 0 0"/>
      <site name="rudder" pos="-0.7 0 0"/>
      <site name="elevator" pos="-0.7 0 0"/>
    </body>
  </worldbody>
  <actuator>
    <general name="propeller" site="propeller" dyntype="user" actdim="1" dynprm="0.5 60"
      gainprm="0" ctrlrange="0 160" actearly="true" actlimited="true" actrange="0 160"/>
    <general name="rudder" site="rudder" dyntype="user" actdim="1" dynprm="0.3 0.5"
      gainprm="0" ctrlrange="-0.3 0.3" actearly="true" actlimited="true" actrange="-0.3 0.3"/>
    <general name="elevator" site="elevator" dyntype="user" actdim="1" dynprm="0.3 0.5"
      gainprm="0" ctrlrange="-0.3 0.3" actearly="true" actlimited="true" actrange="-0.3 0.3"/>
  </actuator>
  <sensor>
    <framepos name="cb_position" objtype="site" objname="cb"/>
    <gyro name="imu_gyro" site="imu"/>
    <accelerometer name="imu_accelerometer" site="imu"/>
  </sensor>
</mujoco>
"""
"""Neither added mass nor coefficients of the hull: its ellipsoid says both. The rotary drag of a
slender one is stiff, hence the step."""
