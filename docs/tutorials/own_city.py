# %% [markdown]
# # Your city
#
# An extract of OpenStreetMap is a file of nodes and ways. [The map's own site](https://www.openstreetmap.org/export)
# exports small ones. To stay offline, this page draws one: two streets, a lane of one way, and houses.

# %%
from pathlib import Path

LAT, LON, METRE = 48.2, 16.37, 1 / 111_200


def nodes_and_ways() -> str:
    nodes: list[str] = []
    ways: list[str] = []

    def way(points: list[tuple[float, float]], **tags: str) -> None:
        refs = []
        for x, y in points:
            place = f'lat="{LAT + y * METRE:.7f}" lon="{LON + x * METRE * 1.5:.7f}"'
            if place not in nodes:
                nodes.append(place)
            refs.append(nodes.index(place) + 1)
        members = "".join(f'<nd ref="{ref}"/>' for ref in refs)
        words = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())
        ways.append(f'<way id="{1000 + len(ways)}">{members}{words}</way>')

    way([(-180, 0), (0, 0), (180, 20)], highway="secondary", name="High Street")
    way([(0, -150), (0, 0), (30, 160)], highway="residential", name="Mill Lane")
    way([(-90, 0), (-80, 70), (12, 64)], highway="residential", name="Back Lane")
    for k in range(7):
        for y in (14, -24):
            x = -170 + 48 * k
            way(
                [(x, y), (x + 30, y), (x + 30, y + 10), (x, y + 10), (x, y)],
                building="yes",
                height=str(7 + k),
            )
    lines = [f'<node id="{k + 1}" {place}/>' for k, place in enumerate(nodes)]
    return "\n".join(['<osm version="0.6">', *lines, *ways, "</osm>"])


Path("village.osm").write_text(nodes_and_ways())

# %% [markdown]
# `carlaloc maps import village.osm --out village` makes a town of it; from Python:

# %%
from recorder import import_town

report = import_town(Path("village.osm"), Path("village"), preview=False)
print({key: report[key] for key in ("streets_m", "built_m", "junctions", "buildings", "drives_on")})

# %% [markdown]
# The report lists what was guessed. Lanes and sidewalks are not tagged here: they follow from the class of
# street.

# %%
print(report["guessed"])

# %% [markdown]
# The folder is a town like any other. The sheet shows it from above and from the street.

# %%
from carlaloc_env import load_town
from recorder import draw_town

built = load_town("village/town.xodr")
print(f"route of {built.route.length_m:.0f} m")
sheet = draw_town(built, Path("village.png"))

# %% [markdown]
# ![The town from above and from the street](village.png)
#
# The environment takes the same file: `gymnasium.make("CarlaLoc-v0", map="village/town.xodr")`. For a real
# place, the pictures carry the words “© OpenStreetMap contributors”.
