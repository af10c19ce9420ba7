-- The board of board.v in VHDL, as small as it gets: SonicSurface's wire, 16 channels, no defects,
-- and no shift registers. FEh begins a frame of codes, FDh swaps the buffers.
library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity board is
    port (clk : in std_logic; rx : in std_logic; pins : out std_logic_vector(15 downto 0));
end entity;

architecture rtl of board is
    constant BIT_CLOCKS : natural := 139;  -- 230400 baud at 32 MHz
    type code_array is array (0 to 31) of unsigned(5 downto 0);
    signal codes : code_array := (others => (others => '0'));
    signal shown : natural range 0 to 1 := 0;
    signal channel : natural range 0 to 255 := 0;
    signal byte_in : std_logic_vector(7 downto 0) := (others => '0');
    signal received : boolean := false;
    signal line : std_logic_vector(1 downto 0) := "11";
    signal bits : natural range 0 to 9 := 0;
    signal wait_clocks : natural range 0 to 2 * BIT_CLOCKS := 0;
    signal clocks : natural range 0 to 24 := 0;
    signal step : unsigned(4 downto 0) := (others => '0');
begin
    uart : process (clk)
    begin
        if rising_edge(clk) then
            line <= line(0) & rx;
            received <= false;
            if bits = 0 then
                if line(1) = '0' then
                    bits <= 9;
                    wait_clocks <= BIT_CLOCKS + BIT_CLOCKS / 2 - 2;
                end if;
            elsif wait_clocks /= 0 then
                wait_clocks <= wait_clocks - 1;
            else
                wait_clocks <= BIT_CLOCKS - 1;
                bits <= bits - 1;
                if bits = 1 then
                    received <= line(1) = '1';
                else
                    byte_in <= line(1) & byte_in(7 downto 1);
                end if;
            end if;
        end if;
    end process;

    buffers : process (clk)
    begin
        if rising_edge(clk) and received then
            if byte_in = x"FE" then
                channel <= 0;
            elsif byte_in = x"FD" then
                channel <= 0;
                shown <= 1 - shown;
            else
                if channel < 16 then
                    codes(16 * (1 - shown) + channel) <= '0' & unsigned(byte_in(4 downto 0));
                    if byte_in = x"20" then
                        codes(16 * (1 - shown) + channel) <= to_unsigned(32, 6);
                    end if;
                end if;
                channel <= (channel + 1) mod 256;
            end if;
        end if;
    end process;

    outputs : process (clk)
        variable since : unsigned(4 downto 0);
    begin
        if rising_edge(clk) then
            clocks <= (clocks + 1) mod 25;
            if clocks = 24 then
                step <= step + 1;
                for n in pins'range loop
                    since := step - codes(16 * shown + n)(4 downto 0);
                    pins(n) <= not since(4) and not codes(16 * shown + n)(5);
                end loop;
            end if;
        end if;
    end process;
end architecture;
