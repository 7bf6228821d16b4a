"""Words that generated C and C++ must not use as names."""

__all__ = ["C_RESERVED", "DEVICE_NAMES", "PROJECT_RESERVED"]

# Names that no file can have on Windows, whatever its ending.
_PORTS = [f"{port}{digit}" for port in ("com", "lpt") for digit in range(10)]
DEVICE_NAMES = frozenset(["con", "prn", "aux", "nul", *_PORTS])

_C_KEYWORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int long register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while asm typeof
nullptr constexpr static_assert thread_local alignas alignof bool true false typeof_unqual fortran
"""

_CPP_KEYWORDS = """
and and_eq bitand bitor catch char8_t char16_t char32_t class compl concept consteval constinit const_cast co_await
co_return co_yield decltype delete dynamic_cast explicit export friend mutable namespace new noexcept not not_eq
operator or or_eq private protected public reinterpret_cast requires static_cast template this throw try typeid
typename using virtual wchar_t xor xor_eq final override import module std
"""

# What headers and compilers define as macros, and the functions that the generated source calls.
_MACROS = """
linux unix i386 near far interface small huge pascal cdecl min max NULL EOF NAN INFINITY HUGE_VAL HUGE_VALF HUGE_VALL
EDOM ERANGE EILSEQ errno stdin stdout stderr assert main sin cos sqrt fabs printf isnan isinf signbit isfinite
fpclassify isnormal signgam complex imaginary I TRUE FALSE BUFSIZ
"""

C_RESERVED = frozenset(f"{_C_KEYWORDS} {_CPP_KEYWORDS} {_MACROS}".split())

# A project gives its name to files, build targets and macros: a header must not hide one of the standard library
# (math.h), a target must not be one of the build system's, and a macro must not be one of a standard header (DBL_MAX).
_HEADERS = """
assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdalign stdarg stdatomic
stdbit stdbool stdckdint stddef stdint stdio stdlib stdnoreturn string tgmath threads time uchar wchar wctype unistd
"""
_TARGETS = """
all clean help install test m c edit_cache rebuild_cache package package_source depend list_install_components
"""
_MACRO_PREFIXES = """
int8 int16 int32 int64 intmax intptr uint uintmax uintptr ptrdiff size wint fp dbl flt ldbl rand sig seek huge
"""

PROJECT_RESERVED = C_RESERVED | DEVICE_NAMES | frozenset(f"{_HEADERS} {_TARGETS} {_MACRO_PREFIXES}".split())
