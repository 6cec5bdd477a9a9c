"""Surface dialogs and dockserver states written for the tests, in the layout of the real ones."""

from __future__ import annotations

from datetime import UTC, datetime

#: 2027-05-04T12:30:00Z, a Tuesday.
MOMENT = 1809433800.0
DAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")
MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


def clock(seconds: float) -> str:
    """The glider's own way to write a UTC time."""
    t = datetime.fromtimestamp(seconds, UTC)
    return f"{DAYS[t.weekday()]} {MONTHS[t.month - 1]} {t.day:2d} {t:%H:%M:%S} {t.year}"


def printout(
    time: float = MOMENT,
    *,
    vehicle: str = "kelp7",
    number: str | None = "kelp7-2027-123-0-41",
    start: float = MOMENT - 90_000.0,
    fix: tuple[str, str] = ("5412.345", "-1023.456"),
    fix_age: float = 30.0,
    inflections: int = 118,
    turned: float = 700.0,
    menu: bool = True,
    sensors: bool = True,
) -> str:
    """One printout; the fix is at 54.20575 N 10.39093 W unless another is given."""
    lines = []
    if number is not None:
        lines += [
            f"Glider {vehicle} at surface.",
            "Because:no comms for a while [behavior surface_3 start_when = 12.0]",
            f"MissionName:deep.mi MissionNum:{number} (0102.0041)",
        ]
    lines += [
        f"Vehicle Name: {vehicle}",
        f"Curr Time: {clock(time)} MT:  {time - start:.0f}",
        "DR  Location:  5412.300 N -1023.400 E measured     41.25 secs ago",
        "GPS TooFar:   69696969.000 N 69696969.000 E measured     1e+308 secs ago",
        "GPS Invalid :  5412.340 N -1023.450 E measured     95.5 secs ago",
        f"GPS Location:  {fix[0]} N {fix[1]} E measured     {fix_age:.3f} secs ago",
    ]
    if sensors:
        lines += [
            "   sensor:c_wpt_lat(lat)=5410                      350.1 secs ago",
            "   sensor:c_wpt_lon(lon)=-1030.5                   350.2 secs ago",
            "   sensor:f_coulomb_battery_capacity(amp-hrs)=550          1e+308 secs ago",
            "   sensor:m_battery(volts)=14.75                     5.5 secs ago",
            "   sensor:m_coulomb_amphr_total(amp-hrs)=100.5       6.5 secs ago",
            "   sensor:m_gps_mag_var(rad)=0.0625                 65.5 secs ago",
            "   sensor:m_lithium_battery_relative_charge(%)=80.25        2.5 secs ago",
            f"   sensor:m_tot_num_inflections(nodim)={inflections}       {turned} secs ago",
            "   sensor:m_vacuum(inHg)=8                           2.5 secs ago",
            "   sensor:m_water_vx(m/s)=-0.125                    70.5 secs ago",
            "   sensor:m_water_vy(m/s)=0.25                      70.75 secs ago",
            "   sensor:x_last_wpt_lat(lat)=69696969             1e+308 secs ago",
        ]
    lines += [
        "devices:(t/m/s) errs:   4/   1/   0 warn:   6/   3/   2 odd:  90/  12/   5",
        "ABORT HISTORY: total since reset: 2",
        "ABORT HISTORY: last abort cause: MS_ABORT_OVERDEPTH",
        "ABORT HISTORY: last abort time: 2027-05-01T03:04:05",
        "ABORT HISTORY: last abort mission: SHALLOW.MI",
    ]
    if menu:
        lines += [
            "Hit Control-R to RESUME the mission, i.e. dive!",
            "Hit Control-C to END   the mission, i.e. GliderDos",
            "Water Velocity Calculations COMPLETE",
            "Waypoint: (5410.0000,-1030.5000) Range: 8765m, Bearing: 245deg, Age: 3:12h:m",
            "Time until diving is: 244 secs",
        ]
    return "\n".join(lines) + "\n"


def state_file(reports: list[tuple[float, float | None, str, str]], waypoint: str = "") -> str:
    """A dockserver state of (surface time, fix time, latitude, longitude) reports."""
    parts = []
    for surfaced, fixed, lat, lon in reports:
        none = "<lat>unavailable</lat><lon>unavailable</lon><time>unavailable</time>"
        t = "" if fixed is None else datetime.fromtimestamp(fixed, UTC).strftime("%Y-%m-%dT%H:%M:%S+0000")
        good = none if fixed is None else f"<lat> {lat}</lat><lon>{lon}</lon><time>{t}</time>"
        parts.append(
            f"<report><surface_date_time>{clock(surfaced)}</surface_date_time><locations>"
            f"<valid_location>{good}</valid_location><invalid_location>{none}</invalid_location>"
            f"<too_far_location>{none}</too_far_location><dr_location>{none}</dr_location></locations></report>"
        )
    return (
        '<?xml version="1.0" encoding="utf-8" standalone="no"?><gliderState> <scriptEngine status="2"/>'
        '<lastAbort cause="MS_ABORT_STALLED" dateTime="2027-05-01T03:04:05 +0000" mission="deep.mi" reset="0" '
        'segment="kelp7-2027-120-0-3"/><writeTrack>'
        + "".join(parts)
        + f"<dataParameters>{waypoint}</dataParameters></writeTrack></gliderState>"
    )
