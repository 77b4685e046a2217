"""The five papers: what each one claims, and in which worlds its methods drive here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

LEAD = "tlbo"
"""The project's own planner, which drives in every paper's worlds too."""

ARRIVES, SAFE, SHORTEST, PACE, FIELD_STUCK = "arrives", "safe", "shortest", "pace", "field_stuck"
"""What is expected of a paper's own method in a world, see `findings`."""


@dataclass(frozen=True, slots=True)
class Drive:
    """A paper's world that the vehicle drives through.

    Attributes:
        world: Name of the scenario.
        own: The paper's method.
        rivals: The methods that the paper compares it with.
        expected: What the paper claims of its method, as far as a drive can show it.
    """

    world: str
    own: str
    rivals: tuple[str, ...] = ()
    expected: tuple[str, ...] = (ARRIVES, SAFE)


@dataclass(frozen=True, slots=True)
class Paper:
    """A paper and its claims.

    Attributes:
        key: Short name, for ``--only`` and for links.
        title: Subject in a few words.
        source: Authors, year, journal.
        claims: What the paper claims, one sentence each.
        runs: The number of runs behind its figures.
        drives: The worlds that are driven for it.
        shown: Further worlds of this benchmark that belong to its figures.
        tables: The start of ``PaperTable.source`` of its tables.
        why: Title of a table, or what was expected of a drive -> the likely reason if the
            measurement here differs.
    """

    key: str
    title: str
    source: str
    claims: tuple[str, ...]
    runs: str
    tables: str
    drives: tuple[Drive, ...] = ()
    shown: tuple[str, ...] = ()
    why: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))


_SABIHA = Paper(
    "sabiha_online",
    "TLBO as the online planner of a tracked robot",
    "Sabiha, Kamel, Said, Hussein 2022, Real-time path planning for autonomous vehicle based on "
    "teaching-learning-based optimization, Intelligent Service Robotics",
    (
        "The robot crosses a room of 5 m x 5 m with twelve unknown obstacles from (0, 0) to "
        "(3.6, 3.9) and is there after 51 s. It replans from what its sensors show.",
        "Nowhere is the path nearer to an obstacle than d_safe, two thirds of the track gauge.",
        "Among four obstacles, TLBO needs fewer iterations and less time than GA, PSO and GA-PSO, "
        "and ends with the smallest J and the smallest spread.",
        "Its paths are the shortest and the smoothest of the four methods.",
        "A PLS model of two components explains how the weights w1 and w2 act on J. J1 and w1 "
        "have the most influence.",
    ),
    "Table 1: 50 runs. Table 2: 25 runs. Weights: 38 runs. Drive: one run.",
    "Sabiha 2022 (online",
    (
        Drive(
            "paper_sabiha_four",
            "tlbo_paper",
            ("ga", "pso", "ga_pso"),
            (ARRIVES, SAFE, SHORTEST),
        ),
        Drive("experiment_paper_pace", LEAD, expected=(ARRIVES, SAFE, PACE)),
    ),
    ("experiment",),
    MappingProxyType({
        "Performance and stability": "The paper stops after 30 iterations without a change; in "
        "double precision J goes on changing in its last digits for much longer. The settings of "
        "GA, PSO and GA-PSO are not printed; common ones are used here, and they come much nearer "
        "to the optimum.",
        "Quality of the path": "The obstacles and the number of points M are not printed. A path "
        "of six points around the rebuilt obstacles needs less turning than the printed one.",
        ARRIVES: "As printed, the planner plans for a point. Its plan often lacks room for the "
        "vehicle's overhang, so the vehicle refuses it and waits for a better one.",
        SAFE: "The vehicle came nearer to an obstacle than a plan may.",
        SHORTEST: "The vehicle replans in every frame and smooths each path. That removes most of "
        "the difference between planners, and a plan that is refused costs a detour.",
        PACE: "The paper prints neither its speed nor its path length; 0.12 m/s is assumed here.",
    }),
)  # fmt: skip

_OFFLINE = Paper(
    "sabiha_offline",
    "TLBO on a known map",
    "Sabiha, Kamel, Said, Hussein 2022, Path planning algorithm based on teaching-learning-based-"
    "optimization for an autonomous vehicle, Communications 24(2)",
    (
        "On a known map with four obstacles, TLBO finds a path near the optimum that keeps 30 cm "
        "from every obstacle.",
        "Over 100 runs J is between 871 and 892 with a standard deviation of 3.62.",
    ),
    "Table 1: 100 runs.",
    "Sabiha 2022 (offline",
    shown=("paper_sabiha_four",),
    why=MappingProxyType({
        "Performance of TLBO": "The unit of the printed J is not stated; it is neither metres nor "
        "centimetres. The two papers print different J for the same map and method.",
    }),
)  # fmt: skip

_MOHAMED = Paper(
    "mohamed",
    "A potential field deformed by a genetic algorithm",
    "Mohamed, Abbas 2012, Optimal path planning for mobile robot based on genetically optimized "
    "artificial potential field, Journal of Engineering and Development 16(4)",
    (
        "One gene for each frontal obstacle turns the attractive force, so that the point mass "
        "leaves the local minima of the plain field.",
        "Every run reaches the target on maps with 5, 50 and 150 obstacles.",
        "The longest path of a map is less than one percent longer than the shortest one.",
        "On the map of 20 x 60 the mean path (61.806) is shorter than that of an improved PSO "
        "(62.503).",
    ),
    "Table 1: 5 runs on the first two maps, 10 on the third.",
    "Mohamed 2012",
    tuple(
        Drive(f"paper_mohamed_{size}", "ga_apf", ("potential_field",), (ARRIVES, SAFE, FIELD_STUCK))
        for size in ("5", "50", "150", "strip")
    ),
    why=MappingProxyType({
        "Three maps": "The obstacles are not printed. Rates, population size and step of the "
        "method are not printed either. The search here stops earlier, with a wider spread.",
        "Against a particle swarm": "The rival of the paper is a quantum variant from another "
        "paper; here it is the common swarm.",
        ARRIVES: "The vehicle knows only what its LiDAR has seen. A field that is deformed for "
        "the known obstacles leads into those not yet seen, and a walk that ends in a minimum is "
        "refused.",
        FIELD_STUCK: "On this map the straight way has no local minimum for the plain field once "
        "the map is seen piece by piece and replanned.",
    }),
)  # fmt: skip

_WU = Paper(
    "wu",
    "TLBO with a nonlinear inertia weight",
    "Wu, Fu, Xue, Wang 2016, A novel global path planning method for mobile robots based on "
    "teaching-learning-based optimization, Information 7(3), 39",
    (
        "In a rotated frame a path is one number on each of 14 cross lines.",
        "NIWTLBO finds the shortest paths with the smallest spread; the order is NIWTLBO, TLBO, "
        "DE, ABC, PSO.",
        "The method can fail on maps that need an N-shaped path, and in rooms.",
    ),
    "Table 1: 30 runs. Further maps: 10 runs.",
    "Wu 2016",
    (
        Drive(
            "paper_wu",
            "niwtlbo",
            ("tlbo_elitist", "de", "abc", "pso"),
            (ARRIVES, SAFE, SHORTEST),
        ),
    ),
    why=MappingProxyType({
        "Path length": "The paper draws an unsafe point again until it is free, which is not "
        "described in enough detail to repeat; here an unsafe path is penalised. The map is "
        "rebuilt, and it has several passages, so that a run can end in a longer one.",
        ARRIVES: "A path crosses each line once and can never lead back, which a partly known map "
        "sometimes requires.",
        SHORTEST: "The vehicle replans in every frame from the previous path, so the five methods "
        "end with nearly the same drive.",
    }),
)  # fmt: skip

_ABED_WORLDS = ("narrow", "trap", "local_minimum", "maze", "moving", "moving_goal")
_ABED = Paper(
    "abed",
    "African vultures, one step at a time",
    "Abed, Lutfy, Al-Doori 2022, Online path planning of mobile robots based on African vultures "
    "optimization algorithm in unknown environments, JESA 55(3)",
    (
        "The robot knows nothing but what it senses, and chooses each heading by AVOA. So it "
        "crosses maps with narrow passages, a trap, a local minimum and a maze.",
        "It avoids moving obstacles and follows a moving goal.",
        "Its paths are shorter than those of adaptive PSO and of a fuzzy controller tuned by wind "
        "driven optimisation.",
    ),
    "Table 2: average lengths; the number of runs is not stated.",
    "Abed 2022",
    tuple(
        Drive(
            f"paper_abed_{world}",
            "avoa_online",
            ("apso_online", "fuzzy_wdo"),
            (ARRIVES, SAFE, SHORTEST),
        )
        for world in _ABED_WORLDS
    ),
    why=MappingProxyType({
        "Average path length": "AVOA and APSO choose one angle from the same candidates by the "
        "same cost. Both find its minimum, so their walks are nearly the same.",
        "Enhancement of AVOA over APSO, %": "See the table above: the two optimise the same "
        "one-dimensional cost.",
        ARRIVES: "A rule that looks one step ahead follows the surface of a dead end, and the "
        "vehicle needs room and time to follow such a walk.",
        SHORTEST: "AVOA and APSO choose one angle by the same cost, so chance decides which of "
        "them drives the shorter way.",
    }),
)  # fmt: skip

PAPERS = (_SABIHA, _OFFLINE, _MOHAMED, _WU, _ABED)
"""The papers, in the order of the page."""
