# %% [markdown]
# # A map of your own
#
# Any OpenDRIVE file is a town. This one has a single road, 600 m long.

# %%
from pathlib import Path

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
Path("one_road.xodr").write_text(MAP)

# %% [markdown]
# `carlaloc maps check one_road.xodr` names what does not fit in a file; from Python:

# %%
from recorder import check_map

print(check_map(Path("one_road.xodr")).errors or "no errors")

# %% [markdown]
# Houses, trees and lamps grow beside the road. The sheet shows the town from above and from the street.

# %%
from carlaloc_env import load_town
from recorder import draw_town

town = load_town("one_road.xodr")
print(f"route of {town.route.length_m:.0f} m")
sheet = draw_town(town, Path("one_road.png"))

# %% [markdown]
# ![The town from above and from the street](one_road.png)
#
# The environment `CarlaLoc-v0` takes the file as its map. Three seconds of six tenths of the throttle:

# %%
import gymnasium
import numpy as np

import carlaloc_env

env = gymnasium.make("CarlaLoc-v0", map="one_road.xodr", rig="state", traffic="empty", info=("truth",))
env.reset(seed=1)
for _ in range(60):
    *_, info = env.step(np.array([0.0, 0.6], np.float32))
print(f"{info['truth'].position_m[0]:.1f} m east")
env.close()
