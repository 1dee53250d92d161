"""Lists the coarse-fine biases of the DAVIS: names, addresses, words and currents.

A bias is a current made on the chip; the bias currents set thresholds, bandwidth and speed of the pixels. Most are
given as a pair (coarse, fine): the coarse value chooses one of eight currents, the fine value how many 255ths of it.

Source: the public drivers of the camera, libcaer 3.3 (addresses, words, defaults) and jAER (currents).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

COARSE_CURRENTS_A = (11e-12, 94e-12, 756e-12, 6.054e-9, 48.437e-9, 387.5e-9, 3.1e-6, 24.8e-6)
"""Amperes that the coarse values 0..7 stand for, at the full fine value (nominal, as in jAER)."""

FULL_FINE = 255

# Bits of a coarse-fine word.
_ENABLED, _N_TYPE, _NORMAL, _NORMAL_CURRENT, _FINE_BIT, _COARSE_BIT = 1, 1 << 1, 1 << 2, 1 << 3, 4, 12


@dataclass(frozen=True)
class CoarseFineBias:
    """A bias current in the units of the chip.

    Args:
        coarse: 0..7, each step about eight times the current of the one before. jAER's files store 7 - coarse.
        fine: 0..255.

    Raises:
        ValueError: for a value out of range.
    """

    coarse: int
    fine: int

    def __post_init__(self) -> None:
        for name, highest in (("coarse", len(COARSE_CURRENTS_A) - 1), ("fine", FULL_FINE)):
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= highest:
                raise ValueError(f"{name} must be an integer in 0..{highest}, got {value!r}")

    def __str__(self) -> str:
        return f"{self.coarse}/{self.fine}"

    @property
    def current_a(self) -> float:
        """The nominal current in amperes: the coarse value's current x fine / 255."""
        return COARSE_CURRENTS_A[self.coarse] * self.fine / FULL_FINE


@dataclass(frozen=True)
class ChipBias:
    """One bias of a chip.

    Attributes:
        name: as in the vendor's drivers.
        address: parameter of the bias module.
        default: what the vendor's driver sends before the start.
        n_type: whether it feeds an n-type transistor; else a p-type one.
        cascode: whether it feeds a cascode.
    """

    name: str
    address: int
    default: CoarseFineBias
    n_type: bool = True
    cascode: bool = False

    def word(self, bias: CoarseFineBias | None = None) -> int:
        """Return the 15-bit word that sets this bias (None: to its default), enabled, at the normal current level."""
        bias = bias or self.default
        flags = _ENABLED | (_N_TYPE if self.n_type else 0) | (0 if self.cascode else _NORMAL) | _NORMAL_CURRENT
        return flags | bias.fine << _FINE_BIT | bias.coarse << _COARSE_BIT


def bias_of_word(word: int) -> CoarseFineBias:
    """Return the current that a coarse-fine word asks for; its other bits are ignored.

    Raises:
        ValueError: for a number of more than 15 bits.
    """
    if not 0 <= word < 1 << 15:
        raise ValueError(f"a coarse-fine word must lie in 0..{(1 << 15) - 1}, got {word}")
    return CoarseFineBias(word >> _COARSE_BIT, word >> _FINE_BIT & FULL_FINE)


def _table(*biases: ChipBias) -> Mapping[str, ChipBias]:
    return MappingProxyType({bias.name: bias for bias in biases})


DAVIS240C_BIASES = _table(
    ChipBias("DiffBn", 0, CoarseFineBias(4, 39)),
    ChipBias("OnBn", 1, CoarseFineBias(5, 255)),
    ChipBias("OffBn", 2, CoarseFineBias(4, 0)),
    ChipBias("ApsCasEpc", 3, CoarseFineBias(5, 185), cascode=True),
    ChipBias("DiffCasBnc", 4, CoarseFineBias(5, 115), cascode=True),
    ChipBias("ApsROSFBn", 5, CoarseFineBias(6, 219)),
    ChipBias("LocalBufBn", 6, CoarseFineBias(5, 164)),
    ChipBias("PixInvBn", 7, CoarseFineBias(6, 144)),
    ChipBias("PrBp", 8, CoarseFineBias(2, 58), n_type=False),
    ChipBias("PrSFBp", 9, CoarseFineBias(1, 16), n_type=False),
    ChipBias("RefrBp", 10, CoarseFineBias(4, 25), n_type=False),
    ChipBias("AEPdBn", 11, CoarseFineBias(6, 91)),
    ChipBias("LcolTimeoutBn", 12, CoarseFineBias(5, 49)),
    ChipBias("AEPuXBp", 13, CoarseFineBias(4, 80), n_type=False),
    ChipBias("AEPuYBp", 14, CoarseFineBias(7, 152), n_type=False),
    ChipBias("IFThrBn", 15, CoarseFineBias(5, 255)),
    ChipBias("IFRefrBn", 16, CoarseFineBias(5, 255)),
    ChipBias("PadFollBn", 17, CoarseFineBias(7, 215)),
    ChipBias("ApsOverflowLevelBn", 18, CoarseFineBias(6, 253)),
    ChipBias("BiasBuffer", 19, CoarseFineBias(5, 254)),
)
"""The coarse-fine biases of the DAVIS240C, by name."""

DAVIS346_BIASES = _table(
    ChipBias("DiffBn", 10, CoarseFineBias(4, 39)),
    ChipBias("OnBn", 11, CoarseFineBias(5, 255)),
    ChipBias("OffBn", 12, CoarseFineBias(4, 1)),
    ChipBias("PixInvBn", 13, CoarseFineBias(5, 129)),
    ChipBias("PrBp", 14, CoarseFineBias(2, 58), n_type=False),
    ChipBias("PrSFBp", 15, CoarseFineBias(1, 16), n_type=False),
    ChipBias("RefrBp", 16, CoarseFineBias(4, 25), n_type=False),
    ChipBias("BiasBuffer", 34, CoarseFineBias(5, 254)),
)
"""The coarse-fine biases of the DAVIS346 that act on its event pixels, by name."""

BIAS_SETS: Mapping[str, Mapping[str, CoarseFineBias]] = MappingProxyType(
    {
        "indoors": MappingProxyType(
            {
                "DiffBn": CoarseFineBias(2, 39),
                "OnBn": CoarseFineBias(4, 200),
                "OffBn": CoarseFineBias(1, 62),
                "PrBp": CoarseFineBias(3, 72),
                "PrSFBp": CoarseFineBias(3, 96),
                "RefrBp": CoarseFineBias(3, 52),
            }
        ),
        "outdoors": MappingProxyType(
            {
                "DiffBn": CoarseFineBias(4, 39),
                "OnBn": CoarseFineBias(6, 200),
                "OffBn": CoarseFineBias(4, 0),
                "PrBp": CoarseFineBias(2, 58),
                "PrSFBp": CoarseFineBias(1, 33),
                "RefrBp": CoarseFineBias(4, 25),
            }
        ),
    }
)
"""The two sets that the recordings of the event-camera dataset were made with (Mueggler et al., IJRR 2017)."""

_NAMES = {name.lower(): name for name in DAVIS240C_BIASES}

BiasValues = Mapping[str, CoarseFineBias | tuple[int, int]]


def as_biases(biases: str | BiasValues) -> dict[str, CoarseFineBias]:
    """Return a set of biases by name, from "indoors", "outdoors", or names with (coarse, fine).

    The case of a name does not matter: the dataset writes ONBn for OnBn.

    Raises:
        ValueError: for a set or a bias that does not exist, a bias given twice, or a value out of range.
    """
    if isinstance(biases, str):
        if biases not in BIAS_SETS:
            raise ValueError(f"there is no set of biases {biases!r}; there is {' and '.join(BIAS_SETS)}")
        return dict(BIAS_SETS[biases])
    by_name: dict[str, CoarseFineBias] = {}
    for given, value in biases.items():
        name = _NAMES.get(given.lower())
        if name is None:
            raise ValueError(f"there is no bias {given!r}; there are {', '.join(DAVIS240C_BIASES)}")
        if name in by_name:
            raise ValueError(f"bias {name} is given twice, the second time as {given!r}")
        try:
            by_name[name] = value if isinstance(value, CoarseFineBias) else CoarseFineBias(*value)
        except (TypeError, ValueError) as error:
            raise ValueError(f"bias {name} must be (coarse, fine), got {value!r}: {error}") from None
    return by_name
