"""The earlier methods that the thesis compares with, one file each (thesis 2.6.6, 6.3, 6.4)."""

from .ayusawa_2010 import Ayusawa2010 as Ayusawa2010
from .diaz_rodriguez_2010 import DiazRodriguez2010 as DiazRodriguez2010
from .diaz_rodriguez_2010 import ReductionStep as ReductionStep
from .farhat_2008 import Farhat2008 as Farhat2008
from .gautier_2013 import Gautier2013 as Gautier2013
from .mata_2005 import Mata2005 as Mata2005
from .method import Method as Method
from .method import Problem as Problem
from .nakanishi_2008 import Nakanishi2008 as Nakanishi2008
from .nakanishi_2008 import NakanishiCorrected as NakanishiCorrected
from .rucker_2022 import Rucker2022 as Rucker2022
from .ting_2006 import Ting2006 as Ting2006
from .yoshida_2000 import VirtualParameterSearch as VirtualParameterSearch
from .yoshida_2000 import Yoshida2000 as Yoshida2000

__all__ = [
    "METHODS",
    "Ayusawa2010",
    "DiazRodriguez2010",
    "Farhat2008",
    "Gautier2013",
    "Mata2005",
    "Method",
    "Nakanishi2008",
    "NakanishiCorrected",
    "Problem",
    "ReductionStep",
    "Rucker2022",
    "Ting2006",
    "VirtualParameterSearch",
    "Yoshida2000",
]

METHODS: tuple[type[Method], ...] = (
    Mata2005,
    Ting2006,
    Farhat2008,
    Nakanishi2008,
    NakanishiCorrected,
    Ayusawa2010,
    DiazRodriguez2010,
    Gautier2013,
    Rucker2022,
)
"""Every method, in the order of its year; ``METHODS[0]()`` has the settings of its paper."""
