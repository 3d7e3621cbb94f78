"""Tables as text for the terminal, as CSV and as Markdown."""
import csv
import dataclasses
import io


@dataclasses.dataclass
class Table:
    """Rows of a name and cells; a cell is a number, a word, or None for nothing."""
    title: str
    corner: str
    columns: list
    rows: list = dataclasses.field(default_factory=list)
    notes: list = dataclasses.field(default_factory=list)
    digits: int = 2
    rank: bool = False  # mark the smallest and second smallest number of each column
    groups: list = dataclasses.field(default_factory=list)  # row numbers before which a rule is drawn (text only)
    _digits: dict = dataclasses.field(default_factory=dict)
    unranked: list = dataclasses.field(default_factory=list)  # row numbers that are not compared with the others

    def add(self, name, cells, digits=None):
        """`digits`: of this row's numbers, where its source has others than the table."""
        self.rows.append((name, list(cells)))
        self._digits[len(self.rows) - 1] = self.digits if digits is None else digits

    def _text(self, row, value):
        if value is None:
            return "-"
        return f"{value:.{self._digits[row]}f}" if isinstance(value, float) else str(value)

    def _places(self):
        """(row, column) -> 1 or 2 for the best and the second best, as printed; equal ones share a place."""
        places = {}
        for c in range(len(self.columns)):
            compared = [(r, cells) for r, (_, cells) in enumerate(self.rows) if r not in self.unranked]
            printed = {r: float(self._text(r, cells[c])) for r, cells in compared if isinstance(cells[c], float)}
            numbers = sorted(set(printed.values()))
            for r, value in printed.items():
                if value in numbers[:2]:
                    places[r, c] = numbers.index(value) + 1
        return places if self.rank else {}

    def text(self):
        places = self._places()
        marks = {1: "*", 2: "+"}
        grid = [[self.corner, *self.columns]]
        for r, (name, cells) in enumerate(self.rows):
            grid.append([name, *(self._text(r, v) + marks.get(places.get((r, c)), " " if self.rank else "")
                                 for c, v in enumerate(cells))])
        widths = [max(len(row[c]) for row in grid) for c in range(len(grid[0]))]
        lines = [self.title]
        for r, row in enumerate(grid):
            if r == 1 or r - 1 in self.groups and r > 1:
                lines.append("  ".join("-" * w for w in widths))
            lines.append("  ".join([row[0].ljust(widths[0])] + [v.rjust(w) for v, w in zip(row[1:], widths[1:])]).rstrip())
        if self.rank:
            lines.append("* best, + second best of the column")
        return "\n".join(lines + self.notes) + "\n"

    def csv(self):
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow([self.corner, *self.columns])
        for name, cells in self.rows:
            writer.writerow([name, *("" if v is None else repr(v) if isinstance(v, float) else v for v in cells)])
        return out.getvalue()

    def markdown(self):
        places = self._places()
        dress = {1: "**{}**", 2: "<u>{}</u>"}
        escape = lambda text: str(text).replace("|", "\\|")
        lines = [f"## {self.title}", "", "| " + " | ".join(map(escape, [self.corner, *self.columns])) + " |",
                 "|---" + "|---:" * len(self.columns) + "|"]
        for r, (name, cells) in enumerate(self.rows):
            texts = [dress.get(places.get((r, c)), "{}").format(escape(self._text(r, v))) for c, v in enumerate(cells)]
            lines.append("| " + " | ".join([escape(name), *texts]) + " |")
        if self.rank:
            lines += ["", "Bold: best, underlined: second best of the column."]
        for note in self.notes:
            lines += ["", note]
        return "\n".join(lines) + "\n"
