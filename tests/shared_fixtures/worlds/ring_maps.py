"""Small maps as other people's programs write them: a ring of 388 m, and two roads joined by a third."""

import math

LANE = '<width sOffset="0" a="3.5" b="0" c="0" d="0"/>'
LINKED = '<link><predecessor id="{0}"/><successor id="{0}"/></link>'
BEND_M = 30.0 * math.pi
RING_M = 200.0 + 2.0 * BEND_M
"""Two straights of 100 m, two half circles of 30 m radius."""


def lane(lane_id: int, body: str = LANE, *, type: str = "driving", link: str | None = None) -> str:
    """A lane with these records; it is linked to itself unless `link` says otherwise."""
    links = LINKED.format(lane_id) if link is None else link
    return f'<lane id="{lane_id}" type="{type}" level="false">{links}{body}</lane>'


def ring_map(
    *,
    root: str = "OpenDRIVE",
    space: str = "",
    header: str = "",
    geometry: str = "",
    right: str = "",
    left: str = "",
    link: str = "",
    more: str = "",
    x: float = 0.0,
    y: float = 0.0,
    length: float = RING_M,
    name: str = "Ring",
) -> str:
    """A ring road of one lane each way whose first straight begins at (x, y) and runs along x.

    Args:
        root: Name of the root, with a prefix if it has one.
        space: Attributes of the root.
        header: What is in the header.
        geometry: More pieces of the reference line.
        right: Lanes right of the centre, in place of lane -1.
        left: Lanes left of it, in place of lane 1.
        link: Road links in place of those that close the ring.
        more: What follows the lanes.
        x: World or projected x of the start [m].
        y: Its y [m].
        length: Length that the road states [m].
        name: The road's name.
    """
    bend = '<geometry s="{}" x="{}" y="{}" hdg="{}" length="{}"><arc curvature="{}"/></geometry>'
    line = '<geometry s="{}" x="{}" y="{}" hdg="{}" length="100"><line/></geometry>'
    plan = (
        line.format(0, x, y, 0)
        + bend.format(100, x + 100, y, 0, BEND_M, 1 / 30)
        + line.format(100 + BEND_M, x + 100, y + 60, math.pi)
        + bend.format(200 + BEND_M, x, y + 60, math.pi, BEND_M, 1 / 30)
        + geometry
    )
    closed = '<predecessor elementType="road" elementId="1" contactPoint="end"/>'
    closed += '<successor elementType="road" elementId="1" contactPoint="start"/>'
    prefix = root.partition(":")[0] + ":" if ":" in root else ""
    text = (
        f'<header revMajor="1" revMinor="6">{header}</header>'
        f'<road name="{name}" length="{length}" id="1" junction="-1"><link>{link or closed}</link>'
        f"<planView>{plan}</planView><lanes><laneSection s='0'><left>{left or lane(1)}</left>"
        f'<center><lane id="0" type="none"/></center><right>{right or lane(-1)}</right></laneSection></lanes>'
        f"{more}</road>"
    )
    if prefix:
        text = text.replace("</", "\0").replace("<", f"<{prefix}").replace("\0", f"</{prefix}")
    return f"<{root} {space}>{text}</{root}>"


def joined_map(*, through: str = "", lanes: str = "", connection: str = "", junction_id: str = "9") -> str:
    """Two roads of 100 m in a line and a connecting road of 20 m between them.

    Args:
        through: Geometry of the connecting road in place of one line.
        lanes: Its lanes in place of lane -1, linked to both roads.
        connection: What is in the junction in place of its one connection.
        junction_id: Id of the junction.
    """

    def road(label: int, x: float, length: float, links: str, body: str, own: str) -> str:
        plan = f'<geometry s="0" x="{x}" y="0" hdg="0" length="{length}"><line/></geometry>'
        inside = junction_id if label == 3 else "-1"
        return (
            f'<road name="" length="{length}" id="{label}" junction="{inside}"><link>{links}</link>'
            f'<planView>{body or plan}</planView><lanes><laneSection s="0"><center><lane id="0"/></center>'
            f"<right>{own}</right></laneSection></lanes></road>"
        )

    plain = lane(-1, link="")
    at = f'elementType="junction" elementId="{junction_id}"'
    ends = '<predecessor elementType="road" elementId="1" contactPoint="end"/>'
    ends += '<successor elementType="road" elementId="2" contactPoint="start"/>'
    usual = '<connection id="0" incomingRoad="1" connectingRoad="3" contactPoint="start">'
    usual += '<laneLink from="-1" to="-1"/></connection>'
    return (
        '<OpenDRIVE><header revMajor="1" revMinor="4"/>'
        + road(1, 0, 100, f"<successor {at}/>", "", plain)
        + road(2, 120, 100, f"<predecessor {at}/>", "", plain)
        + road(3, 100, 20, ends, through, lanes or lane(-1))
        + f'<junction id="{junction_id}" name="J">{connection or usual}</junction></OpenDRIVE>'
    )
