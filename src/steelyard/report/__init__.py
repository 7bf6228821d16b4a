"""Reports of identifications and simulations: a folder of results, an HTML page, and a picture."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .charts import Chart as Chart
    from .charts import Curve as Curve
    from .charts import charts_markup as charts_markup
    from .comparison_page import comparison_html as comparison_html
    from .comparison_page import write_comparison as write_comparison
    from .fleet_page import fleet_html as fleet_html
    from .fleet_results import save_fleet as save_fleet
    from .html import report_html as report_html
    from .html import write_report as write_report
    from .html_document import Section as Section
    from .html_document import html_document as html_document
    from .picture import torque_picture as torque_picture
    from .picture import torque_svg as torque_svg
    from .plot import torque_plot as torque_plot
    from .results import require_apart as require_apart
    from .results import require_folder as require_folder
    from .results import require_replaceable as require_replaceable
    from .results import save_results as save_results
    from .robot_picture import robot_picture as robot_picture
    from .robot_picture import robot_svg as robot_svg

__all__ = import_at_first_use(__name__, __file__)
