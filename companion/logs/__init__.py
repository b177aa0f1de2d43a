"""Files to columns: telemetry logs (.tlog), on-board logs (DataFlash, ULog), compressed or not."""

from companion.logs.dataflash import DataflashLog, RecordLayout, Records, read_dataflash
from companion.logs.dataflash_text import read_dataflash_text
from companion.logs.logfile import MOST_BYTES, Contents, log_format, looks_like_a_log
from companion.logs.tlog import Log, read_tlog
from companion.logs.ulog import Ulog, read_ulog
from companion.logs.ulog_topics import UlogTopic
