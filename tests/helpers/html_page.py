"""An HTML page taken apart: its tags with their attributes, and its words."""

from html.parser import HTMLParser


class Tags(HTMLParser):
    """`opened`: every tag with its attributes. `words`: every stretch of text between tags."""

    def __init__(self, page: str):
        super().__init__()
        self.opened: list[tuple[str, dict]] = []
        self.words: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.opened.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.words.append(data)
