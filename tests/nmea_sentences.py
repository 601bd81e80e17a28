"""NMEA sentences for tests."""

from datetime import UTC, datetime
from functools import reduce
from operator import xor


def sentence(*fields):
    """A sentence with its checksum."""
    body = ",".join(map(str, fields))
    return f"${body}*{reduce(xor, body.encode()):02X}"


def clock(time):
    """The time of day and the date of seconds since 1970 as NMEA writes them."""
    when = datetime.fromtimestamp(round(time, 4), UTC)
    return when.strftime("%H%M%S.%f"), when.strftime("%d%m%y")


def minutes(degrees, width, sides):
    whole, part = divmod(abs(degrees), 1.0)
    return f"{int(whole):0{width}d}{part * 60.0:012.9f}", sides[int(degrees < 0.0)]


def gga(time, latitude, longitude, altitude="", geoid="", quality=4, hdop=0.8):
    """GGA of seconds since 1970, degrees, m."""
    place = (*minutes(latitude, 2, "NS"), *minutes(longitude, 3, "EW"))
    return sentence("GNGGA", clock(time)[0], *place, quality, 12, hdop, altitude, "M", geoid, "M", "", "")


def rmc(time):
    """RMC, for its date."""
    return sentence("GNRMC", clock(time)[0], "A", "5200.0", "N", "01000.0", "E", "1.0", "", clock(time)[1], "", "", "A")


def zda(time):
    """ZDA, for its date, of any year."""
    when = datetime.fromtimestamp(time, UTC)
    return sentence("GNZDA", clock(time)[0], f"{when.day:02d}", f"{when.month:02d}", when.year, "00", "00")
