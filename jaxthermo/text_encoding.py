"""Text of files of other programs, which do not state its encoding."""


def decoded_text(content: bytes) -> str:
    """Text in UTF-8, with or without a byte order mark, or else in Latin-1.

    Any bytes are Latin-1: its letters are in names and comments, and numbers are the
    same in both. Lines end in a line feed.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")
