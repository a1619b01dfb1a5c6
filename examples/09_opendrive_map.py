"""An OpenDRIVE map of your own becomes a town to drive in."""

from pathlib import Path

import gymnasium
import numpy as np

import carlaloc_env  # noqa: F401  registers the environments

MAP = """<?xml version="1.0"?>
<OpenDRIVE>
  <header revMajor="1" revMinor="4" name="one_road"/>
  <road name="Long Street" length="600" id="1" junction="-1">
    <type s="0" type="town"><speed max="50" unit="km/h"/></type>
    <planView>
      <geometry s="0" x="0" y="0" hdg="0" length="300"><line/></geometry>
      <geometry s="300" x="300" y="0" hdg="0" length="300"><arc curvature="0.004"/></geometry>
    </planView>
    <lanes>
      <laneSection s="0">
        <left><lane id="1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></left>
        <center><lane id="0" type="none">
          <roadMark sOffset="0" type="broken" color="white" width="0.12"/></lane></center>
        <right>
          <lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>
          <lane id="-2" type="sidewalk"><width sOffset="0" a="2" b="0" c="0" d="0"/></lane>
        </right>
      </laneSection>
    </lanes>
  </road>
</OpenDRIVE>
"""


def main(out: Path = Path("one_road.xodr"), steps: int = 60) -> float:
    """Drive straight ahead on it, and return the distance [m]."""
    out.write_text(MAP)
    env = gymnasium.make("CarlaLoc-v0", map=str(out), rig="state", traffic="empty", info=("truth",))
    env.reset(seed=1)
    places = []
    for _ in range(steps):
        *_, info = env.step(np.array([0.0, 0.6], np.float32))
        places.append(info["truth"].position_m)
    env.close()
    way_m = float(np.linalg.norm(places[-1] - places[0]))
    print(f"{way_m:.1f} m in {steps * 0.05:.1f} s on {out}")
    return way_m


if __name__ == "__main__":
    main()
