"""Prints the kind of each frame through iceoryx2's own package: iceoryx2_package.py ROOT PREFIX SENSOR N_REPORTS

Without ROOT and PREFIX iceoryx2's defaults are those of natural kinds, so that `iox2.config.default()` does as it is.
"""

import sys
import time

import iceoryx2 as iox2
from natural_kinds._layout import ReportFields


class Report(ReportFields):
    @staticmethod
    def type_name() -> str:
        return "natural_kinds::KindReport"


# It tells whoever has no configuration file so; there is none here, by intent.
iox2.set_log_level(iox2.LogLevel.Error)
root, prefix, sensor, n_reports = sys.argv[1:]
config = iox2.config.default()
config.global_cfg.root_path = iox2.Path.new(root)
config.global_cfg.prefix = iox2.FileName.new(prefix)
node = iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)
name = iox2.ServiceName.new(f"natural-kinds/{sensor}/kinds")
subscriber = node.service_builder(name).publish_subscribe(Report).open().subscriber_builder().create()
n_left = int(n_reports)
while n_left > 0:
    sample = subscriber.receive()
    if sample is None:
        time.sleep(0.001)
        continue
    report = sample.payload().contents
    print(f"frame {report.sequence}: kind {report.kind}, probability {report.probabilities[report.kind]:.6f}", flush=True)
    n_left -= 1
