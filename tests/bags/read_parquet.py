"""Reads every Parquet table in a folder with pyarrow, prints types, number of rows and the last row."""

import datetime
import json
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

report = {}
for path in Path(sys.argv[1]).glob("*.parquet"):
    table = pq.read_table(path)
    last = {}
    for name in table.column_names:
        column = table[name]
        value = column[-1]
        last[name] = value.value if pa.types.is_timestamp(column.type) else value.as_py()
        if isinstance(last[name], (bytes, datetime.datetime)):
            last[name] = str(last[name])
    report[path.stem] = {
        "rows": table.num_rows,
        "types": {field.name: str(field.type) for field in table.schema},
        "last": last,
    }
json.dump(report, sys.stdout)
