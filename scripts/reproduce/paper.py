"""The paper's figures, from the one file that has them: paper.json."""
import json
import pathlib

PATH = pathlib.Path(__file__).with_name("paper.json")


def load(path=PATH):
    """The data file as it is: {"source": {...}, "tables": {name: {...}}}."""
    with open(path, encoding="utf-8") as file:
        return json.load(file)


def source_text(data, table):
    """Where a table's figures are from, for people."""
    source = data["source"]
    return f'{source["title"]} ({source["file"]}, {table["label"]})'
