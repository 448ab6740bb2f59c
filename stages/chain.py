"""The chain of stages in the order in which they depend on each other; workers import one stage, not this."""

from pipeline.engine.stage import Stage
from stages.aggregate import AGGREGATE
from stages.clearance import CLEARANCE
from stages.drivers import DRIVERS
from stages.forms import FORMS
from stages.hysteresis import HYSTERESIS
from stages.reduce import REDUCE
from stages.report import report_of
from stages.sample import SAMPLE
from stages.scales import SCALES
from stages.springs import SPRINGS
from stages.tails import TAILS
from stages.worst import WORST

UPSTREAM = (SAMPLE, CLEARANCE, SPRINGS, REDUCE, HYSTERESIS, WORST, FORMS, DRIVERS, TAILS, AGGREGATE, SCALES)
REPORT = report_of(UPSTREAM)
STAGES: tuple[Stage, ...] = (*UPSTREAM, REPORT)
