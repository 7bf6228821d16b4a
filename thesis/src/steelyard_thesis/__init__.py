"""The earlier methods, tables and figures of C. D. Sousa's thesis (2014), computed again with Steelyard."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .closed_form import PolynomialCondition as PolynomialCondition
    from .closed_form import closed_form_conditions as closed_form_conditions
    from .closed_form import feasibility_polynomials as feasibility_polynomials
    from .cobyla import minimise_with_cobyla as minimise_with_cobyla
    from .methods import METHODS as METHODS
    from .methods import Ayusawa2010 as Ayusawa2010
    from .methods import DiazRodriguez2010 as DiazRodriguez2010
    from .methods import Farhat2008 as Farhat2008
    from .methods import Gautier2013 as Gautier2013
    from .methods import Mata2005 as Mata2005
    from .methods import Method as Method
    from .methods import Nakanishi2008 as Nakanishi2008
    from .methods import NakanishiCorrected as NakanishiCorrected
    from .methods import ReductionStep as ReductionStep
    from .methods import Rucker2022 as Rucker2022
    from .methods import Ting2006 as Ting2006
    from .methods import VirtualParameterSearch as VirtualParameterSearch
    from .methods import Yoshida2000 as Yoshida2000
    from .reproduction import Reproduction as Reproduction
    from .reproduction import reproduce as reproduce
    from .tabulated_model import TabulatedModel as TabulatedModel

__version__ = "0.1.0"
__all__ = import_at_first_use(__name__, __file__)
